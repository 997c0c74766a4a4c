"""Errors of a study's files, and reading what the book of the study knows: nothing else is believed."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

SPACE, ENVIRONMENT, WARNINGS = "search_space.yaml", "sessions", "warnings"
"""The search space, a file of a study; documents of its book."""

# The machine is short of something, and the file is none the worse.
_MACHINE = (errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.EACCES, errno.EPERM, errno.EINTR, errno.ESTALE)


class StoreError(Exception):
    """A study folder cannot be written or read; one line says why. Finished runs are never lost."""


class Damaged(StoreError):
    """A file is missing, or not what was written; the line says what to do."""


class InUse(StoreError):
    """Another process works on the study."""


REMEDY = "`dse doctor RESULTS` says what it costs and repairs it"


def damaged(path: Path, what: object, remedy: str = REMEDY) -> Damaged:
    """Return the error about a damaged file."""
    return Damaged(f"{path}: {what}; {remedy}")


def no_space() -> str:
    """Return what a sentence about a full disk ends with."""
    return "; free some space and run the same command again; finished runs are kept"


def unreadable(path: Path, error: OSError) -> StoreError:
    """Return the error about a file that the system does not give: missing, or not to be had now."""
    if isinstance(error, FileNotFoundError | NotADirectoryError):
        return damaged(path, "is missing")
    if error.errno is None:  # of a library, about the content
        return damaged(path, f"cannot be read: {str(error).splitlines()[0]}")
    hint = "" if error.errno in _MACHINE else "; the disk may be failing"
    return StoreError(f"{path}: cannot be read: {os.strerror(error.errno)}{hint}")


def check_kind(path: Path) -> None:
    """Refuse what is no file: a pipe would never end."""
    if not stat.S_ISREG(path.stat().st_mode):
        raise damaged(path, "is not a file")
