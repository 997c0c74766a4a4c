"""The files of a folder: which there are, in one order, and what they hold."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Iterator, Sequence
from fnmatch import fnmatchcase
from pathlib import Path, PurePosixPath

from dse.recordings import RecordingError
from dse.recordings.files import content

_MOST_NAMED = 5


def files_below(folder: Path, pattern: str) -> list[str]:
    """Return the paths below a folder that match a pattern, sorted, with / between their parts.

    Files and folders whose names begin with a dot are left out, and links to a folder that they lie in.
    Folders in which nothing can match are not opened.

    Args:
        folder: an existing folder.
        pattern: parts as fnmatch has them; a part `**` stands for any number of folders.

    Raises:
        RecordingError: a folder cannot be read.
    """
    about = folder.stat()
    parts = PurePosixPath(pattern).parts
    names = _below(folder, "", parts, ((about.st_dev, about.st_ino),))
    return sorted(name for name in names if _fits(name.split("/"), parts))


def content_of(folder: Path, names: Iterable[str]) -> str:
    """Return a hash of the paths of some files below a folder and of what is in them.

    Raises:
        RecordingError: a file cannot be read.
    """
    digest = hashlib.sha256()
    for name in names:
        try:
            digest.update(os.fsencode(name) + f"\0{content(folder / name)}\n".encode())
        except RecordingError as error:
            raise RecordingError(by_path(error, name)) from None
    return digest.hexdigest()


def by_path(error: RecordingError, name: str) -> str:
    """Return a sentence about a file with its path below the folder in place of its bare name."""
    bare = name.rpartition("/")[2]
    text = str(error)
    return text if text.startswith(f"{name}: ") else f"{name}: {text.removeprefix(f'{bare}: ')}"


def some(names: Sequence[str]) -> str:
    """Return the first names in quotes, and how many more there are."""
    listed = ", ".join(f"'{name}'" for name in names[:_MOST_NAMED])
    return listed if len(names) <= _MOST_NAMED else f"{listed} and {len(names) - _MOST_NAMED} more"


def _below(
    folder: Path, above: str, pattern: Sequence[str], within: tuple[tuple[int, int], ...]
) -> Iterator[str]:
    """Yield the paths of the files below a folder; `within` are the folders that it lies in."""
    try:
        entries = [entry for entry in os.scandir(folder) if not entry.name.startswith(".")]
    except OSError as error:
        raise RecordingError(f"{folder}: cannot be read: {error.strerror or error}") from None
    for entry in entries:
        if os.path.isdir(entry.path):  # entry.is_dir() raises where a link leads to itself
            about = entry.stat()
            identity = about.st_dev, about.st_ino
            inside = f"{above}{entry.name}/"
            if identity not in within and _may_hold(inside.split("/")[:-1], pattern):
                yield from _below(folder / entry.name, inside, pattern, (*within, identity))
        # A link to nothing is a file that cannot be read, and not one to pass over.
        elif os.path.isfile(entry.path) or not os.path.exists(entry.path):
            yield f"{above}{entry.name}"


def _may_hold(names: Sequence[str], pattern: Sequence[str]) -> bool:
    """Return whether a path below a folder of these names can match."""
    for name, part in zip(names, pattern, strict=False):
        if part == "**":
            return True
        if not fnmatchcase(name, part):
            return False
    return len(names) < len(pattern)


def _fits(names: Sequence[str], pattern: Sequence[str]) -> bool:
    if not pattern:
        return not names
    if pattern[0] == "**":
        return _fits(names, pattern[1:]) or (bool(names) and _fits(names[1:], pattern))
    return bool(names) and fnmatchcase(names[0], pattern[0]) and _fits(names[1:], pattern[1:])
