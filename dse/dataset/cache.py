"""Prepared data on disk, shared by every study, job and process of a user.

    <root>/<key>/       an entry: its files, `entry.json` with their sizes, and `lock`
    <root>/.part-*      being written, or being removed; whose lock is free was left by a process that died

The root is $DSE_CACHE, else $XDG_CACHE_HOME/dse, else ~/.cache/dse. A key says everything that its entry
follows from, so that an entry never changes: it is written under another name, flushed to the disk, and
renamed. Two that write the same entry at once both succeed, and one of the two is kept.

Whoever reads or writes an entry holds it: a shared lock on its `lock`, which the system takes away when the
process ends, however it ends. What is in the root changes only under the lock of the root, so that an entry
is never removed between being found and being held. When all entries together take more than the limit
($DSE_CACHE_GIB), those that nobody holds go, least recently used first; but none within a minute of its use,
so that whoever has it made by another process has the time to hold it.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import secrets
import shutil
import time
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self, TypeVar

Told = TypeVar("Told")

MOST_GIB = 20.0
"""Limit where DSE_CACHE_GIB is not set, or a tenth of the disk if that is less."""

_GRACE_S = 60.0
_PART = ".part-"
_LOCK = "lock"
_ENTRY = "entry.json"
_OWN = (_LOCK, _ENTRY)


@dataclass(frozen=True)
class Hold:
    """An entry that stays until it is closed; `folder` holds its files."""

    folder: Path
    handle: int

    def close(self) -> None:
        """Let go of the entry, once."""
        os.close(self.handle)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        self.close()


def usual_root() -> Path:
    """Return where this user's entries lie.

    Raises:
        RuntimeError: the user has no home folder.
    """
    if chosen := os.environ.get("DSE_CACHE"):
        return Path(chosen).expanduser().absolute()
    base = Path(os.environ.get("XDG_CACHE_HOME", ""))
    # A relative path in XDG_CACHE_HOME is void, says its specification.
    return (base if base.is_absolute() else Path.home() / ".cache") / "dse"


def opened_root(instead: Path) -> tuple[Path, str]:
    """Return the usual root, or `instead` where that cannot be written, with a sentence that says why.

    What dead processes left there is removed, and what the limit leaves no room for.

    Raises:
        OSError: `instead` cannot be written either.
    """
    try:
        root = usual_root()
        tidy(root)
        return root, ""
    except (OSError, RuntimeError) as error:
        tidy(instead)
        return instead, f"prepared data cannot be shared and goes to {instead}: {error}"


def limit_bytes(root: Path) -> int:
    """Return how much the entries may take together: DSE_CACHE_GIB, else 20 GiB or a tenth of the disk.

    Raises:
        ValueError: DSE_CACHE_GIB is no number of at least 0.
    """
    text = os.environ.get("DSE_CACHE_GIB", "")
    if not text:
        return min(int(MOST_GIB * 2**30), shutil.disk_usage(root).total // 10)
    with contextlib.suppress(ValueError, OverflowError):
        if (gib := float(text)) >= 0:
            return int(gib * 2**30)
    raise ValueError(f"DSE_CACHE_GIB must be a number of GiB, at least 0, got '{text}'")


def hold(root: Path, key: str) -> Hold | None:
    """Return a hold of an entry, or None where there is none; a damaged one is removed.

    Raises:
        OSError: the root cannot be written.
    """
    with _changing(root):
        return _held(root / key)


def made(
    root: Path, key: str, fill: Callable[[Path], Generator[Told, None, None]]
) -> Generator[Told, None, Hold]:
    """Return a hold of an entry that is there now; yield what `fill` yields while it writes the files.

    Args:
        root: from `opened_root`.
        key: a file name.
        fill: called with an empty folder where the entry is not there; it writes files, no folders.

    Raises:
        OSError: the disk refuses; nothing of the entry is left.
        ValueError: from `limit_bytes`.
    """
    there = hold(root, key)
    if there is not None:
        return there
    with _changing(root):
        part = root / f"{_PART}{key}-{secrets.token_hex(4)}"
        part.mkdir()
        handle = _locked(part)
    kept = None
    try:
        yield from fill(part)
        sizes = {path.name: path.stat().st_size for path in part.iterdir() if path.name not in _OWN}
        (part / _ENTRY).write_text(json.dumps(sizes), encoding="utf-8")
        for path in (*part.iterdir(), part):
            _flush(path)
        with _changing(root):
            kept = _held(root / key)  # somebody was faster: what follows from the same is the same
            if kept is None:
                os.replace(part, root / key)
                kept, handle = Hold(root / key, handle), -1
                _flush(root)
    finally:
        if handle >= 0:
            os.close(handle)
            shutil.rmtree(part, ignore_errors=True)
    with contextlib.ExitStack() as undo:
        undo.callback(kept.close)
        tidy(root)
        undo.pop_all()
    return kept


def discard(root: Path, key: str) -> None:
    """Remove an entry whose content is of no use; processes that have mapped its files keep them."""
    with _changing(root):
        _removed(root / key)


def tidy(root: Path) -> None:
    """Remove what dead processes left; then, while there is more than the limit, what was used longest ago.

    Raises:
        OSError: the root cannot be written.
        ValueError: from `limit_bytes`.
    """
    root.mkdir(parents=True, exist_ok=True)
    limit = limit_bytes(root)
    doomed = []
    with _changing(root):
        for part in root.glob(f"{_PART}*"):
            if _is_free(part):
                doomed.append(part)
        # A folder without readable sizes is no entry: whatever else somebody keeps here stays.
        sizes = {path: _sizes(path) for path in root.iterdir() if path.name[0] != "."}
        entries = {path: sum(each.values()) for path, each in sizes.items() if each is not None}
        too_much = sum(entries.values()) - limit
        since = (time.time() - _GRACE_S) * 1e9
        for path in sorted(entries, key=_last_use):
            if too_much <= 0 or _last_use(path) > since:
                break
            if _is_free(path):
                doomed.append(_set_aside(path))
                too_much -= entries[path]
    for path in doomed:  # the lock of the root is not kept for as long as this may take
        shutil.rmtree(path, ignore_errors=True)


@contextlib.contextmanager
def _changing(root: Path) -> Iterator[None]:
    """Hold the root for one process, for as long as it takes to look at names and change them."""
    handle = os.open(root / f".{_LOCK}", os.O_RDWR | os.O_CREAT, 0o644)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def _locked(folder: Path) -> int:
    """Return a handle that shares the lock of a folder; only the holder of the root ever takes it alone."""
    handle = os.open(folder / _LOCK, os.O_RDWR | os.O_CREAT, 0o644)
    fcntl.flock(handle, fcntl.LOCK_SH)
    return handle


def _held(folder: Path) -> Hold | None:
    if not folder.is_dir():
        return None
    sizes = _sizes(folder)
    if sizes is None or any(not _has_size(folder / name, size) for name, size in sizes.items()):
        _removed(folder)
        return None
    handle = _locked(folder)
    os.utime(handle)
    return Hold(folder, handle)


def _is_free(folder: Path) -> bool:
    """Return whether no process holds a folder."""
    try:
        handle = os.open(folder / _LOCK, os.O_RDWR)
    except FileNotFoundError:  # its writer died before it had a lock, or it is being removed
        return True
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    finally:
        os.close(handle)
    return True


def _set_aside(folder: Path) -> Path:
    """Rename a folder so that it is no entry any more, and is removed even if this process dies now."""
    aside = folder.with_name(f"{_PART}{folder.name}-{secrets.token_hex(4)}")
    os.replace(folder, aside)
    return aside


def _removed(folder: Path) -> None:
    if folder.is_dir():
        shutil.rmtree(_set_aside(folder), ignore_errors=True)


def _sizes(folder: Path) -> dict[str, int] | None:
    """Return the sizes that an entry's files must have; None where nothing readable says so."""
    try:
        sizes = json.loads((folder / _ENTRY).read_text(encoding="utf-8"))
        return {str(name): int(size) for name, size in sizes.items()}
    except (OSError, ValueError, AttributeError, TypeError):
        return None


def _has_size(path: Path, size: int) -> bool:
    return path.is_file() and path.stat().st_size == size


def _last_use(folder: Path) -> int:
    """Return when an entry was last held; one without a lock is damaged, and the first to go."""
    try:
        return (folder / _LOCK).stat().st_mtime_ns
    except FileNotFoundError:
        return 0


def _flush(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
