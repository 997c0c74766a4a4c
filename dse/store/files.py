"""Writing files and folders whole or not at all, and holding a study's folder for one process."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import hashlib
import json
import os
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

WARNINGS = "warnings.json"
_TEMPORARY = ".writing-"


class StoreError(Exception):
    """A study folder cannot be written or read, in one line; nothing finished is lost."""


@contextlib.contextmanager
def explained(path: Path) -> Iterator[None]:
    """Turn what the disk refuses in the block into a StoreError about `path`."""
    try:
        yield
    except OSError as error:
        why = os.strerror(error.errno) if error.errno else str(error)
        full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
        hint = "; free some space and run the same command again: finished runs are kept" if full else ""
        raise StoreError(f"{path}: cannot be written: {why}{hint}") from error


@contextlib.contextmanager
def exclusive(folder: Path) -> Iterator[None]:
    """Hold a study folder for one process; the system lets go of it when the process ends, however it ends.

    Raises:
        StoreError: another process holds it, or the folder cannot be made.
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
def published(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path` to write a file or a folder at; rename it when the block succeeds.

    A folder that exists already stays, and what was written is dropped: a finished run is never replaced.

    Raises:
        StoreError: the disk refuses (full, read-only, ...).
    """
    temporary = path.with_name(f"{_TEMPORARY}{path.name}-{os.getpid()}")
    with explained(path):
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            yield temporary
            _flush(temporary)
            try:
                os.replace(temporary, path)
            except OSError as error:
                if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
                    raise
            _flush_one(path.parent)
        finally:
            remove(temporary)


def remove(path: Path) -> None:
    """Remove a file or a folder if it is there."""
    if path.is_dir() and not path.is_symlink():
        # Renamed first, so that a crash cannot leave a folder that looks finished but lacks files.
        doomed = path.with_name(f"{_TEMPORARY}{path.name}-doomed")
        with contextlib.suppress(FileNotFoundError):
            if not path.name.startswith(_TEMPORARY):
                os.replace(path, doomed)
                path = doomed
            shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def sweep(folder: Path) -> None:
    """Remove what crashed writers left behind, anywhere under a study folder."""
    for left in folder.rglob(f"{_TEMPORARY}*"):
        remove(left)


def _flush(path: Path) -> None:
    for each in [*path.rglob("*"), path] if path.is_dir() else [path]:
        _flush_one(each)


def _flush_one(path: Path) -> None:
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
    """Replace a JSON file. NaN and infinities are written as Python's json does."""
    write_text(path, json.dumps(document, indent=1, default=plain) + "\n")


def plain(value: Any) -> Any:
    """Return numpy values and tuples as JSON knows them."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(f"{type(value).__name__} cannot be written as JSON")


def read_json(path: Path) -> Any:
    """Return a JSON file's content.

    Raises:
        StoreError: it is missing or damaged.
    """
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise StoreError(f"{path}: cannot be read: {error}") from error


def checksum(path: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
