"""Find the data files that a YAML file names, in one place or below a folder in one order, and hash them."""

from __future__ import annotations

import functools
import hashlib
import os
from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase
from pathlib import Path, PurePosixPath
from typing import Literal

from dse.data.recordings import RecordingError

TABLES = (".csv", ".tsv", ".parquet")
"""Endings of tables; of texts (`TEXTS`), .txt is one where it is named, in a folder it may be anything."""
TEXTS = (".csv", ".tsv", ".txt")
_PARTS = {"train": "train", "training": "train", "test": "test", "testing": "test"}
_PARTS |= dict.fromkeys(("val", "valid", "validation"), "validation")


def locate(name: str, base: Path, kind: Literal["file", "folder"] = "file") -> Path:
    """Return the path of data: absolute, or the first below `base`, $DSE_DATA and the working folder.

    A folder of tables is a file as well: one table.

    Raises:
        RecordingError: they are in none of these places; the sentence lists them.
    """
    roots = [base, *(Path(x) for x in [os.environ.get("DSE_DATA", "")] if x), Path.cwd()]
    places = [Path(name)] if Path(name).is_absolute() else [root / name for root in roots]
    for place in places:
        if place.is_file() or tables_below(place) if kind == "file" else place.is_dir():
            return place
    for place in places:
        if place.exists():
            raise RecordingError(f"data {kind} '{name}': {place} must be a {kind}, and is none")
    looked = ", ".join(str(place.parent) for place in places)
    hint = f" (DSE_DATA sets another folder, --set data.{kind}={kind.upper()} another {kind})"
    advice = "" if Path(name).is_absolute() else hint
    raise RecordingError(f"data {kind} '{name}' not found; looked in {looked}{advice}")


def tables_below(folder: Path) -> list[str]:
    """Return the tables below a folder, as `files_below`, but for one of labels; none where it is none."""
    names = files_below(folder, "**/*") if folder.is_dir() else []
    return [x for x in names if x.lower().endswith((*TABLES, ".npy")) and not x.startswith("labels.")]


def part_of(name: str) -> str | None:
    """Return the part of a published split that the first folder of a path names; None: no such folder."""
    first, *others = PurePosixPath(name).parts
    return _PARTS.get(first.lower()) if len(others) > 1 else None


def content(path: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal; it is read again only where size or time have changed.

    That of a folder is of its tables.

    Raises:
        RecordingError: it cannot be read.
    """
    if path.is_dir():
        return content_of(path, tables_below(path))
    try:
        about = path.stat()
        return _content(path, about.st_size, about.st_mtime_ns)
    except OSError as error:
        raise RecordingError(f"{path.name}: cannot be read: {error.strerror or error}") from error


@functools.cache
def _content(path: Path, size: int, modified_ns: int) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def files_below(folder: Path, pattern: str) -> list[str]:
    """Return the paths below a folder that match a pattern, sorted, with / between their parts.

    Files and folders whose names begin with a dot are left out, links to a folder that they lie in, and what
    is no file, such as a pipe; a link to nothing is a file that cannot be read.

    Args:
        folder: an existing folder.
        pattern: parts as fnmatch has them; a part `**` stands for any number of folders.

    Raises:
        RecordingError: a folder cannot be read.
    """

    def refuse(error: OSError) -> None:
        raise RecordingError(f"{error.filename}: cannot be read: {error.strerror or error}")

    parts, found = PurePosixPath(pattern).parts, []
    above = {str(folder): {_identity(folder)}}  # of every folder, what it lies in and what it is
    for place, folders, files in os.walk(folder, followlinks=True, onerror=refuse):
        within = above[place]
        paths = {name: os.path.join(place, name) for name in folders if not name.startswith(".")}
        paths = {name: path for name, path in paths.items() if _identity(path) not in within}
        folders[:] = paths
        above |= {path: within | {_identity(path)} for path in paths.values()}
        for name in (name for name in files if not name.startswith(".")):
            path = os.path.join(place, name)
            if os.path.isfile(path) or not os.path.exists(path):
                found.append(os.path.relpath(path, folder).replace(os.sep, "/"))
    return sorted(name for name in found if _fits(name.split("/"), parts))


def _identity(path: str | Path) -> tuple[int, int]:
    about = os.stat(path)
    return about.st_dev, about.st_ino


def _fits(names: Sequence[str], pattern: Sequence[str]) -> bool:
    if not pattern:
        return not names
    if pattern[0] == "**":
        return _fits(names, pattern[1:]) or (bool(names) and _fits(names[1:], pattern))
    return bool(names) and fnmatchcase(names[0], pattern[0]) and _fits(names[1:], pattern[1:])


def content_of(folder: Path, names: Iterable[str]) -> str:
    """Return a hash of the paths of some files below a folder and of what is in them."""
    digest = hashlib.sha256()
    for name in names:
        try:
            digest.update(os.fsencode(name) + f"\0{content(folder / name)}\n".encode())
        except RecordingError as error:
            raise RecordingError(by_path(error, name)) from None
    return digest.hexdigest()


def by_path(error: RecordingError, name: str) -> str:
    """Return a sentence about a file with its path below the folder in place of its bare name."""
    bare, text = name.rpartition("/")[2], str(error)
    return text if text.startswith(f"{name}: ") else f"{name}: {text.removeprefix(f'{bare}: ')}"
