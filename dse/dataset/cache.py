"""Prepared data on disk, shared by every study, job and process of a user.

    <root>/<key>/         an entry: its files, and `entry.json` with their sizes
    <root>/.writing-*     being written or removed; one whose writer has died is removed

The root is $DSE_CACHE, else $XDG_CACHE_HOME/dse, else ~/.cache/dse. A key is a hash of everything that its
entry follows from, so an entry never changes. Two processes that write the same entry at once both succeed,
and the first is kept.

When all entries together exceed the limit ($DSE_CACHE_GIB), the least recently used are evicted, but none
that was used within a day. A process that has mapped the files of an evicted entry keeps them; a process
that misses an entry makes it again.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from dse.store import atomic, is_temporary, remove

MOST_GIB = 20.0
"""Limit where DSE_CACHE_GIB is not set, or a tenth of the disk if that is less."""

EVICTABLE_AFTER_S = 24 * 3600.0
"""An entry is evicted no sooner after its last use."""

_LOCK = ".lock"
_ENTRY = "entry.json"


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
    """Return the limit of all entries together: DSE_CACHE_GIB, else 20 GiB or a tenth of the disk.

    Raises:
        ValueError: DSE_CACHE_GIB is not a number of at least 0.
    """
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
        OSError: the root cannot be written.
    """
    folder = root / key
    if not folder.is_dir():
        return None
    sizes = _sizes(folder)
    if sizes is None or any(not _has_size(folder / name, size) for name, size in sizes.items()):
        remove(folder)
        return None
    mark_used(folder)
    return folder


def mark_used(folder: Path) -> None:
    """Put an entry last in the order of eviction."""
    with contextlib.suppress(OSError):  # evicted by now, or on a disk that is read-only
        os.utime(folder / _ENTRY)


def made(root: Path, key: str, fill: Callable[[Path], None]) -> Path:
    """Return the folder of an entry, which is made if it is not there.

    Args:
        root: from `opened_root`.
        key: a file name.
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
        sizes = {path.name: path.stat().st_size for path in part.iterdir() if path.name != _LOCK}
        (part / _ENTRY).write_text(json.dumps(sizes), encoding="utf-8")
    tidy(root)
    return root / key


def discard(root: Path, key: str) -> None:
    """Remove an entry; processes that have mapped its files keep them."""
    remove(root / key)


def tidy(root: Path) -> None:
    """Remove what dead writers left; then, while the limit is exceeded, the least recently used entries.

    Raises:
        OSError: the root cannot be written.
        ValueError: from `limit_bytes`.
    """
    root.mkdir(parents=True, exist_ok=True)
    limit = limit_bytes(root)
    with _locked(root):
        abandoned = [path for path in root.iterdir() if is_temporary(path) and not _is_locked(path)]
    for part in abandoned:
        remove(part)
    # A folder without readable sizes is no entry: whatever else a user stores here stays.
    sizes = {path: _sizes(path) for path in root.iterdir() if path.name[0] != "."}
    entries = {path: sum(each.values()) for path, each in sizes.items() if each is not None}
    last_use_s = {path: _last_use_s(path) for path in entries}
    excess = sum(entries.values()) - limit
    evictable_s = time.time() - EVICTABLE_AFTER_S
    for path in sorted(entries, key=last_use_s.__getitem__):
        if excess <= 0 or last_use_s[path] > evictable_s:
            break
        remove(path)
        excess -= entries[path]


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Lock a folder for this process; the system releases the lock when the process ends."""
    handle = os.open(folder / _LOCK, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def _is_locked(folder: Path) -> bool:
    try:
        handle = os.open(folder / _LOCK, os.O_RDWR)
    except OSError:  # no lock: its writer died before, or it is being removed
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(handle)
    return False


def _sizes(folder: Path) -> dict[str, int] | None:
    """Return the sizes that an entry's files must have; None where nothing readable states them."""
    try:
        sizes = json.loads((folder / _ENTRY).read_text(encoding="utf-8"))
        return {str(name): int(size) for name, size in sizes.items()}
    except (OSError, ValueError, AttributeError, TypeError):
        return None


def _has_size(path: Path, size: int) -> bool:
    return path.is_file() and path.stat().st_size == size


def _last_use_s(folder: Path) -> float:
    """Return when an entry was last used; 0 where another process is removing it."""
    try:
        return (folder / _ENTRY).stat().st_mtime
    except FileNotFoundError:
        return 0.0
