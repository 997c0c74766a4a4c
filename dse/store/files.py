"""Write files and folders whole or not at all, and lock a study's folder for one process."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import hashlib
import json
import os
import secrets
import shutil
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from dse.store.plain import plain
from dse.store.sealed import REMEDY, Damaged, StoreError, blank, damaged, is_sealed, read_bytes, seal

WARNINGS = "warnings.json"
TEMPORARY = ".writing-"
"""Begins the names of files and folders that are being written."""
_GLANCES, _GLANCE_S = 4, 0.05  # times that a lock is asked for, and between them
_SEAL = "seal"
_COMMENT = "# "
_ROWS = "rows"


@contextlib.contextmanager
def explained(path: Path) -> Iterator[None]:
    """Turn an OSError of the block into a StoreError about `path`."""
    try:
        yield
    except OSError as error:
        reason = os.strerror(error.errno) if error.errno else str(error)
        full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
        hint = "; free some space and run the same command again; finished runs are kept" if full else ""
        raise StoreError(f"{path}: cannot be written: {reason}{hint}") from error


@contextlib.contextmanager
def exclusive(folder: Path) -> Iterator[None]:
    """Lock a study folder for this process; the system releases the lock when the process ends.

    Raises:
        StoreError: another process has the lock, or the folder cannot be made, or its name is not UTF-8, as
            tables need.
    """
    try:
        str(folder).encode()
    except UnicodeEncodeError:
        raise StoreError(
            f"{os.fsencode(folder)!r}: the folder of a study must have a name in UTF-8"
        ) from None
    with explained(folder):
        folder.mkdir(parents=True, exist_ok=True)
    with contextlib.ExitStack() as held:
        # The folder too: somebody may remove the file. Not every file system locks folders.
        for path, flags in ((folder, os.O_RDONLY), (folder / ".lock", os.O_RDWR | os.O_CREAT)):
            with explained(path):
                if path != folder and os.path.lexists(path) and not path.is_file():
                    remove(path)  # such as a link that leads nowhere
                handle = os.open(path, flags, 0o644)
            held.callback(os.close, handle)
            try:
                _lock(handle)
            except BlockingIOError:
                raise StoreError(f"{folder}: another process is running this study") from None
            except OSError as error:
                if path != folder:
                    text = f"cannot be locked ({error.strerror}); use a --results folder on another disk"
                    raise StoreError(f"{folder}: {text}") from None
        yield


def is_held(folder: Path) -> bool | None:
    """Return whether a process holds the lock of a study folder (`exclusive`); None if nobody can tell."""
    try:
        handle = os.open(folder / ".lock", os.O_RDONLY | os.O_NONBLOCK)
    except FileNotFoundError:
        return False
    except OSError:
        return None
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return None
    finally:
        os.close(handle)
    return False


def _lock(handle: int) -> None:
    """Lock an open file; who looks whether it is locked (`is_held`) has it for an instant.

    Raises:
        OSError: it is locked, or cannot be.
    """
    for left in reversed(range(_GLANCES)):
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        except BlockingIOError:
            if not left:
                raise
            time.sleep(_GLANCE_S)


@contextlib.contextmanager
def atomic(path: Path, *, replaces: bool = False) -> Iterator[Path]:
    """Yield a temporary path beside `path` to write a file or a folder at; rename it when the block succeeds.

    A crash at any moment leaves the old file or the new one. A file is replaced. A folder that exists already
    stays, and the new one is dropped.

    Args:
        path: where it will be.
        replaces: whether a folder that exists gives way; a crash may then leave none.

    Raises:
        OSError: the disk is full, read-only, or fails otherwise; nothing is left behind.
    """
    temporary = _beside(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        for each in [*temporary.rglob("*"), temporary] if temporary.is_dir() else [temporary]:
            _sync(each)
        if replaces:
            remove(path)
        try:
            os.replace(temporary, path)
        except OSError as error:
            if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
                raise
        _sync(path.parent)
    finally:
        remove(temporary)


@contextlib.contextmanager
def published(path: Path, *, replaces: bool = False) -> Iterator[Path]:
    """Do as `atomic`, for a path of a study: a finished run is never replaced.

    Raises:
        StoreError: the disk is full, read-only, or fails otherwise.
    """
    with explained(path), atomic(path, replaces=replaces) as temporary:
        yield temporary


def remove(path: Path) -> None:
    """Remove a file or a folder if it exists."""
    if path.is_dir() and not path.is_symlink():
        # Renamed first, so that a crash cannot leave a folder that looks finished but lacks files.
        if not is_temporary(path):
            doomed = _beside(path)
            try:
                os.replace(path, doomed)
            except FileNotFoundError:  # another process removed it
                return
            path = doomed
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def is_temporary(path: Path) -> bool:
    """Return whether a path is the temporary one of a writer, living or dead."""
    return path.name.startswith(TEMPORARY)


def sweep(folder: Path) -> None:
    """Remove the temporary files and folders of dead writers under a folder that no process writes to."""
    for temporary in folder.rglob(f"{TEMPORARY}*"):
        remove(temporary)


def _beside(path: Path) -> Path:
    return path.with_name(f"{TEMPORARY}{path.name}-{os.getpid()}-{secrets.token_hex(4)}")


def _sync(path: Path) -> None:
    """Write what the system buffers of a file or a folder to the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def write_text(path: Path, text: str) -> None:
    """Replace a text file."""
    with published(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_sealed_text(path: Path, text: str) -> None:
    """Replace a text file in whose format `#` begins a comment; the first line is its seal."""
    with published(path) as temporary:
        temporary.write_text(f"{_COMMENT}{blank(path).decode()}\n{text}", encoding="utf-8")
        seal(temporary)


def read_sealed_text(path: Path) -> str:
    """Return the text of `write_sealed_text`, or of any text file that needs no seal.

    Raises:
        Damaged: it is missing, or not what was written.
        StoreError: it cannot be read now.
    """
    try:
        text = read_bytes(path).decode("utf-8")
    except UnicodeDecodeError as error:
        raise damaged(path, f"cannot be read: {error}") from None
    if "\n" not in text or "\0" in text:
        raise damaged(path, "has no whole line, or NUL characters")
    first, _, rest = text.partition("\n")
    return rest if first.startswith(_COMMENT) and is_sealed(first.encode()) else text


def write_json(path: Path, document: Mapping[str, Any] | Sequence[Any]) -> None:
    """Replace a JSON file. NaN and infinities are written as Python's json does.

    Raises:
        TypeError: the document holds something that JSON cannot hold.
    """
    with published(path) as temporary:
        write_sealed_json(temporary, document)


def write_sealed_json(path: Path, document: Mapping[str, Any] | Sequence[Any]) -> None:
    """Write a JSON file at once: an object, its seal first; a list is its member `rows`.

    Raises:
        OSError: the file cannot be written.
        TypeError: as in `write_json`.
    """
    members = document if isinstance(document, Mapping) else {_ROWS: document}
    content = json.dumps({_SEAL: blank(path).decode(), **members}, indent=1, default=plain)
    path.write_text(content + "\n", encoding="utf-8")
    seal(path)


def read_or_remove(path: Path, note: Callable[[str], object]) -> Any:
    """Return the document of a JSON file; None where there is none, or a damaged one, which is removed.

    Raises:
        StoreError: it cannot be read now.
    """
    try:
        return read_json(path) if path.exists() else None
    except Damaged as error:
        note(f"{str(error).removesuffix(f'; {REMEDY}')}; it is written anew")
        remove(path)
        return None


def read_json(path: Path, *, needs_seal: bool | None = None) -> Any:
    """Return the document of a JSON file, without its seal; `needs_seal` as in `read_bytes`.

    Raises:
        Damaged: it is missing, or not what was written.
        StoreError: it cannot be read now.
    """
    try:
        document = json.loads(read_bytes(path, needs_seal=needs_seal))
    except (ValueError, RecursionError) as error:
        raise damaged(path, f"cannot be read: {error}") from None
    if not isinstance(document, dict):
        return document
    document.pop(_SEAL, None)
    return document[_ROWS] if document.keys() == {_ROWS} else document


def checksum(path: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
