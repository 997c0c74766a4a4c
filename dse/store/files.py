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
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from dse.store.plain import plain

WARNINGS = "warnings.json"
_TEMPORARY = ".writing-"


class StoreError(Exception):
    """A study folder cannot be written or read; one line says why. Finished runs are never lost."""


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
        StoreError: another process has the lock, or the folder cannot be made.
    """
    with explained(folder):
        folder.mkdir(parents=True, exist_ok=True)
        handle = os.open(folder / ".lock", os.O_RDWR | os.O_CREAT, 0o644)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise StoreError(f"{folder}: another process is running this study") from None
        yield
    finally:
        os.close(handle)


@contextlib.contextmanager
def atomic(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path` to write a file or a folder at; rename it when the block succeeds.

    A crash at any moment leaves the old file or the new one. A file is replaced. A folder that exists already
    stays, and the new one is dropped.

    Raises:
        OSError: the disk is full, read-only, or fails otherwise; nothing is left behind.
    """
    temporary = _beside(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        for each in [*temporary.rglob("*"), temporary] if temporary.is_dir() else [temporary]:
            _sync(each)
        try:
            os.replace(temporary, path)
        except OSError as error:
            if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
                raise
        _sync(path.parent)
    finally:
        remove(temporary)


@contextlib.contextmanager
def published(path: Path) -> Iterator[Path]:
    """Do as `atomic`, for a path of a study: a finished run is never replaced.

    Raises:
        StoreError: the disk is full, read-only, or fails otherwise.
    """
    with explained(path), atomic(path) as temporary:
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
    return path.name.startswith(_TEMPORARY)


def sweep(folder: Path) -> None:
    """Remove the temporary files and folders of dead writers under a folder that no process writes to."""
    for temporary in folder.rglob(f"{_TEMPORARY}*"):
        remove(temporary)


def _beside(path: Path) -> Path:
    return path.with_name(f"{_TEMPORARY}{path.name}-{os.getpid()}-{secrets.token_hex(4)}")


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


def write_json(path: Path, document: Any) -> None:
    """Replace a JSON file. NaN and infinities are written as Python's json does.

    Raises:
        TypeError: the document holds something that JSON cannot hold.
    """
    write_text(path, json.dumps(document, indent=1, default=plain) + "\n")


def read_json(path: Path) -> Any:
    """Return a JSON file's content.

    Raises:
        StoreError: it is missing or damaged.
    """
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise StoreError(f"{path}: cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise StoreError(f"{path}: cannot be read: {error}") from error


def checksum(path: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
