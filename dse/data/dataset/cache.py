"""Prepared data on disk, shared by every study, job and process of a user.

    <root>/<key>/         an entry: its files, and `entry.json` with its key, their sizes and checksums
    <root>/.writing-*     being written or removed; one whose writer has died is removed

The root is $DSE_CACHE, else $XDG_CACHE_HOME/dse, else ~/.cache/dse. A key is a hash of everything that its
entry follows from, so an entry never changes. Two processes that write the same entry at once both succeed,
and the first is kept.

When all entries together exceed the limit ($DSE_CACHE_GIB), the least recently used are evicted, but none
that was used within a day. A process that has mapped the files of an evicted entry keeps them; a process
that misses an entry makes it again. A process checks the checksums of an entry when it first finds it.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from dse.store import atomic, checksum, is_held, is_temporary, remove

MOST_GIB = 20.0
"""Limit where DSE_CACHE_GIB is not set, or a tenth of the disk if that is less."""

EVICTABLE_AFTER_S = 24 * 3600.0
"""An entry is evicted no sooner after its last use."""

_LOCK = ".lock"
_ENTRY = "entry.json"

_ABSENT = (FileNotFoundError, NotADirectoryError, IsADirectoryError)
_intact: set[Path] = set()  # entries whose checksums this process has checked


def usual_root() -> Path:
    """Return the folder of this user's entries.

    Raises:
        RuntimeError: the user has no home folder.
    """
    if root := os.environ.get("DSE_CACHE"):
        return Path(root).expanduser().absolute()
    base = Path(os.environ.get("XDG_CACHE_HOME", ""))
    # The specification of XDG_CACHE_HOME says that a relative path is invalid.
    return (base if base.is_absolute() else Path.home() / ".cache") / "dse"


def opened_root(instead: Path) -> tuple[Path, str]:
    """Return the usual root, or `instead` and the reason where the usual root cannot be written.

    The root is tidied.

    Raises:
        OSError: `instead` cannot be written either.
    """
    try:
        root = usual_root()
        tidy(root)
        return root, ""
    except (OSError, RuntimeError) as error:
        tidy(instead)
        return instead, f"prepared data cannot be cached for other runs and are written to {instead}: {error}"


def limit_bytes(root: Path) -> int:
    """Return the limit of all entries together: DSE_CACHE_GIB, else 20 GiB or a tenth of the disk."""
    text = os.environ.get("DSE_CACHE_GIB", "")
    if not text:
        return min(int(MOST_GIB * 2**30), shutil.disk_usage(root).total // 10)
    with contextlib.suppress(ValueError, OverflowError):
        if (gib := float(text)) >= 0:
            return int(gib * 2**30)
    raise ValueError(f"DSE_CACHE_GIB must be a number of GiB, at least 0, got '{text}'")


def find(root: Path, key: str) -> Path | None:
    """Return the folder of an entry, or None where there is none; a damaged one is removed.

    Raises:
        OSError: the root cannot be written, or a file cannot be read now.
    """
    folder = root / key
    if not folder.is_dir():
        return None
    files = _files(folder)
    if files is None or not _is_intact(folder, files):
        discard(root, key)
        return None
    mark_used(folder)
    return folder


def _is_intact(folder: Path, files: Mapping[str, tuple[int, str]]) -> bool:
    """Return whether the files of an entry have their sizes and, once per process, their checksums."""
    try:
        if any((folder / name).stat().st_size != size for name, (size, _) in files.items()):
            return False
        if folder not in _intact:
            if any(checksum(folder / name) != digest for name, (_, digest) in files.items()):
                return False
            _intact.add(folder)
    except _ABSENT:
        return False
    return True


def mark_used(folder: Path) -> None:
    """Put an entry last in the order of eviction."""
    with contextlib.suppress(OSError):  # evicted by now, or on a disk that is read-only
        os.utime(folder / _ENTRY)


def made(root: Path, key: str, fill: Callable[[Path], None]) -> Path:
    """Return the folder of an entry, which is made if it is not there.

    fill: writes the files of the entry, and no folders, to the empty folder that it is given.

    Raises:
        OSError: the disk is full or fails otherwise; nothing of the entry is left.
        ValueError: from `limit_bytes`.
    """
    folder = find(root, key)
    if folder is not None:
        return folder
    with contextlib.ExitStack() as until_renamed, atomic(root / key) as part:
        with _locked(root):  # between these two lines the folder looks like a dead writer's
            part.mkdir()
            until_renamed.enter_context(_locked(part))
        fill(part)
        files = {
            path.name: [path.stat().st_size, checksum(path)] for path in part.iterdir() if path.name != _LOCK
        }
        (part / _ENTRY).write_text(json.dumps({"key": key, "files": files}), encoding="utf-8")
    _intact.discard(root / key)  # the entry of another process may be in its place
    tidy(root)
    return root / key


def discard(root: Path, key: str) -> None:
    """Remove an entry; processes that have mapped its files keep them."""
    _intact.discard(root / key)
    remove(root / key)


def tidy(root: Path) -> None:
    """Remove what dead writers left; then, while the limit is exceeded, the least recently used entries.

    Raises:
        OSError: the root cannot be written.
        ValueError: from `limit_bytes`.
    """
    root.mkdir(parents=True, exist_ok=True)
    limit, now_s = limit_bytes(root), time.time()
    with _locked(root):
        abandoned = [path for path in root.iterdir() if is_temporary(path) and is_held(path) is False]
    for part in abandoned:
        remove(part)
    # A folder without a readable `entry.json` is no entry: whatever else a user stores here stays.
    sizes, last_use_s = {}, {}
    for path in (path for path in root.iterdir() if path.name[0] != "."):
        with contextlib.suppress(OSError):  # nobody knows, or another process is removing it
            if (files := _files(path)) is not None:
                used_s = (path / _ENTRY).stat().st_mtime
                if used_s > now_s:
                    mark_used(path)  # the clock was set back: it would never be evicted
                sizes[path], last_use_s[path] = sum(size for size, _ in files.values()), min(used_s, now_s)
    excess = sum(sizes.values()) - limit
    for path in sorted(sizes, key=last_use_s.__getitem__):
        if excess <= 0 or last_use_s[path] > now_s - EVICTABLE_AFTER_S:
            break
        remove(path)
        excess -= sizes[path]


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Lock a folder for this process; the system releases the lock when the process ends."""
    handle = os.open(folder / _LOCK, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def _files(folder: Path) -> dict[str, tuple[int, str]] | None:
    """Return the sizes and the checksums that an entry's files must have; None where it does not state them.

    What is wrong in `entry.json` contradicts the files, so it needs no checksum of its own.
    """
    try:
        entry = json.loads((folder / _ENTRY).read_text(encoding="utf-8"))
        if entry["key"] != folder.name:
            return None
        return {str(name): (int(size), str(digest)) for name, (size, digest) in entry["files"].items()}
    except (*_ABSENT, KeyError, ValueError, AttributeError, TypeError, RecursionError):
        return None
