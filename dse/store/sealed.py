"""The seal of a file: the SHA-256 of the whole file, held in the file itself.

The seal is `dse-sha256:` and 64 hexadecimal digits, at a place that the format of the file leaves free: the
first member of a JSON object, a comment in the first line of text, the comment of an .npz archive, the last
metadata of a Parquet file. The digest is that of the file with zeros for digits. So a change of a byte shows,
and other programs read the file as before.

`environment.json` says of every session of a study whether it wrote seals. If all did, a file without a seal
is damaged; otherwise an earlier version wrote it, and it is read as it is.
"""

from __future__ import annotations

import errno
import hashlib
import json
import mmap
import os
import re
import stat
from pathlib import Path

_MARK = b"dse-sha256:"
_ZEROS = b"0" * 64
BLANK = _MARK + _ZEROS
"""What a writer puts where the seal will be."""

_SEAL = re.compile(re.escape(_MARK))
# The seal lies within so many bytes of the beginning or of the end of a file.
_NEAR = 1 << 16

ENVIRONMENT = "environment.json"
_DEEPEST = 6  # folders of a study above a file: checkpoints/<epochs>/artefacts/<trial>/repeat_<k>

# The machine is short of something, and the file is none the worse.
_MACHINE = (errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.EACCES, errno.EPERM, errno.EINTR, errno.ESTALE)


class StoreError(Exception):
    """A study folder cannot be written or read; one line says why. Finished runs are never lost."""


class Damaged(StoreError):
    """A file is missing, or not what was written; the line says what to do."""


REMEDY = "`dse doctor RESULTS` says what it costs and repairs it"


def damaged(path: Path, what: object, remedy: str = REMEDY) -> Damaged:
    """Return the error about a damaged file."""
    return Damaged(f"{path}: {what}; {remedy}")


def seal(path: Path) -> None:
    """Put the digest of a file in place of its `BLANK`, which was written once.

    Raises:
        ValueError: the file has none.
        OSError: it cannot be written.
    """
    with path.open("r+b") as file:
        content = file.read()
        place = _place(content)
        if place is None:
            raise ValueError(f"{path}: has no place for a seal")
        file.seek(place + len(_MARK))
        file.write(_digest(content, place).encode())


def is_sealed(content: bytes | mmap.mmap) -> bool:
    """Return whether the content of a file has a seal, right or wrong."""
    return _place(content) is not None


def requires_seal(path: Path) -> bool:
    """Return whether a file is in a study whose sessions all wrote seals."""
    for folder in path.parents[:_DEEPEST]:
        if (folder / ENVIRONMENT).is_file():
            try:
                document = json.loads((folder / ENVIRONMENT).read_bytes())
                sessions = document["rows"] if isinstance(document, dict) else document
                return bool(sessions) and all(session.get("sealed") is True for session in sessions)
            except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
                return False  # damaged itself: nobody knows, and runs of an earlier version are not lost
    return False


def read_bytes(path: Path, *, needs_seal: bool | None = None) -> bytes:
    """Return the content of a file after its seal is checked.

    Args:
        path: of the file.
        needs_seal: whether a file without a seal is damaged; None: as its study says (`requires_seal`).

    Raises:
        Damaged: the file is missing, or its content is not what was sealed.
        StoreError: it cannot be read now, such as for lack of file descriptors.
    """
    try:
        _check_kind(path)
        content = path.read_bytes()
    except OSError as error:
        raise unreadable(path, error) from None
    _check(path, content, needs_seal)
    return content


def verify(path: Path) -> None:
    """Check the seal of a file of any size.

    Raises:
        Damaged, StoreError: as in `read_bytes`.
    """
    try:
        _check_kind(path)
        with path.open("rb") as file:
            if not os.fstat(file.fileno()).st_size:
                raise damaged(path, "is empty")
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
                _check(path, content)
    except OSError as error:
        raise unreadable(path, error) from None


def unreadable(path: Path, error: OSError) -> StoreError:
    """Return the error about a file that the system does not give: missing, or not to be had now."""
    if isinstance(error, FileNotFoundError | NotADirectoryError):
        return damaged(path, "is missing")
    if error.errno is None:  # of a library, about the content
        return damaged(path, f"cannot be read: {str(error).splitlines()[0]}")
    hint = "" if error.errno in _MACHINE else "; the disk may be failing"
    return StoreError(f"{path}: cannot be read: {os.strerror(error.errno)}{hint}")


def _check_kind(path: Path) -> None:
    """Refuse what is no file: a pipe would never end."""
    if not stat.S_ISREG(path.stat().st_mode):
        raise damaged(path, "is not a file")


def _check(path: Path, content: bytes | mmap.mmap, needs_seal: bool | None = None) -> None:
    place = _place(content)
    if place is None:
        if requires_seal(path) if needs_seal is None else needs_seal:
            raise damaged(path, "is damaged (its checksum is missing)")
        return
    begin = place + len(_MARK)
    if content[begin : begin + len(_ZEROS)] != _digest(content, place).encode():
        raise damaged(path, "is damaged (its checksum differs)")


def _place(content: bytes | mmap.mmap) -> int | None:
    """Return where the seal begins: the first one near the beginning, else the last one near the end."""
    if match := _SEAL.search(content, 0, _NEAR):
        return match.start()
    places = [match.start() for match in _SEAL.finditer(content, max(0, len(content) - _NEAR))]
    return places[-1] if places else None


def _digest(content: bytes | mmap.mmap, place: int) -> str:
    """Return the digest of a file with zeros in place of the digits of its seal."""
    begin = place + len(_MARK)
    with memoryview(content) as view:
        digest = hashlib.sha256(view[:begin])
        digest.update(_ZEROS)
        digest.update(view[begin + len(_ZEROS) :])
    return digest.hexdigest()
