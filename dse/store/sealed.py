"""The seal of a file: the SHA-256 of the whole file, held in the file itself.

The seal is `dse-sha256:` and 64 hexadecimal digits, at a place that the format of the file leaves free: the
first member of a JSON object, a comment in the first line of text, the comment of an .npz archive, the last
metadata of a Parquet file. The digest is that of the file with zeros for digits. So a change of a byte shows,
and other programs read the file as before.

Within a study the digits are followed by `@` and the study's identity, 16 hexadecimal digits that its first
session draws. So a whole file of another study is damage, also of one of the same name and search space.

`environment.json` says of every session of a study whether it wrote seals, and of which identity. If all did,
a file without a seal, or without an identity, is damaged; otherwise an earlier version wrote it, and it is
read as it is. If files disagree about the identity, the one that most of them name counts.
"""

from __future__ import annotations

import contextlib
import errno
import functools
import hashlib
import itertools
import json
import mmap
import os
import re
import secrets
import stat
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

_MARK = b"dse-sha256:"
_ZEROS = b"0" * 64

_SEAL = re.compile(re.escape(_MARK))
_IDENTITY = re.compile(rb"@([0-9a-f]{16})")
# Of a text with a seal, and of the first line of a journal.
_NAMED = re.compile(rb'dse-sha256:[0-9a-f]{64}@([0-9a-f]{16})|"identity":"([0-9a-f]{16})"')
# The seal lies within so many bytes of the beginning or of the end of a file.
_NEAR = 1 << 16
_BEGINNING = 512

ENVIRONMENT, SPACE, JOURNAL = "environment.json", "search_space.yaml", "journal.log"
_DEEPEST = 6  # folders of a study above a file: checkpoints/<epochs>/artefacts/<trial>/repeat_<k>
# What says which study a folder holds, should its files disagree: these, and so many of its runs.
_WITNESSES, _RUNS, _MOST_RUNS = (SPACE, JOURNAL), "artefacts/*/repeat_*/record.json", 9

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


@dataclass(frozen=True)
class _Rule:
    """What the files of a study must have.

    needs_seal: a seal. identity: no other one; '': none; None: any. needs_identity: one in every seal.
    """

    needs_seal: bool = False
    identity: str | None = None
    needs_identity: bool = False


def blank(path: Path) -> bytes:
    """Return what a writer puts where the seal of a file will be."""
    of_study = identity(path)
    return _MARK + _ZEROS + (f"@{of_study}".encode() if of_study else b"")


def seal(path: Path) -> None:
    """Put the digest of a file in place of the digits of its `blank`, which was written once.

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
    return _rule(path).needs_seal


def identity(path: Path) -> str:
    """Return the identity of the study that a file is in; '' if there is none."""
    return _rule(path).identity or ""


def new_identity() -> str:
    """Return the identity of a study that begins."""
    return secrets.token_hex(8)


def witnessed(folder: Path, said: str = "") -> str:
    """Return the identity that most files of a study name; `said`: the one in `environment.json`."""
    paths = [*(folder / name for name in _WITNESSES), *itertools.islice(folder.glob(_RUNS), _MOST_RUNS)]
    votes = Counter([said] * bool(said) + [_named(path) for path in paths if path.is_file()])
    return max(votes, key=lambda one: votes[one], default="")


def _rule(path: Path) -> _Rule:
    for folder in path.parents[:_DEEPEST]:
        with contextlib.suppress(OSError):
            status = (folder / ENVIRONMENT).stat()
            if stat.S_ISREG(status.st_mode):
                return _rule_of(folder.absolute(), _state(status), _state_of(folder / SPACE))
    return _Rule()


def _state(status: os.stat_result) -> tuple[int, int, int]:
    return status.st_ino, status.st_size, status.st_mtime_ns


def _state_of(path: Path) -> tuple[int, int, int] | None:
    try:
        return _state(path.stat())
    except OSError:
        return None


@functools.lru_cache(maxsize=64)
def _rule_of(folder: Path, *_: tuple[int, int, int] | None) -> _Rule:
    """Return the rule of a study whose `environment.json` and search space are in some state.

    Raises:
        OSError: the former cannot be read now.
    """
    try:
        document = json.loads((folder / ENVIRONMENT).read_bytes())
        sessions = document["rows"] if isinstance(document, dict) else document
        identities = [str(session.get("identity") or "") for session in sessions]
        is_sealed = bool(sessions) and all(session.get("sealed") is True for session in sessions)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        # damaged itself: runs of an earlier version are not lost
        return _Rule(identity=witnessed(folder) or None)
    said = next((one for one in reversed(identities) if one), "")
    return _Rule(is_sealed, witnessed(folder, said) if said else "", is_sealed and all(identities))


def _named(path: Path) -> str:
    """Return the identity that a text file names at its beginning; '' if there is none."""
    try:
        with path.open("rb") as file:
            match = _NAMED.search(file.read(_BEGINNING))
    except OSError:
        return ""
    return "" if match is None else (match[1] or match[2]).decode()


def read_bytes(path: Path, *, needs_seal: bool | None = None) -> bytes:
    """Return the content of a file after its seal is checked.

    Args:
        path: of the file.
        needs_seal: whether a file without a seal is damaged, of whichever study it is; None: as its study
            says (`requires_seal`), whose file it must be.

    Raises:
        Damaged: the file is missing, or its content is not what was sealed.
        StoreError: it cannot be read now, such as for lack of file descriptors.
    """
    try:
        check_kind(path)
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
        check_kind(path)
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


def check_kind(path: Path) -> None:
    """Refuse what is no file: a pipe would never end.

    Raises:
        Damaged: it is none.
        OSError: there is nothing.
    """
    if not stat.S_ISREG(path.stat().st_mode):
        raise damaged(path, "is not a file")


def _check(path: Path, content: bytes | mmap.mmap, needs_seal: bool | None = None) -> None:
    place, rule = _place(content), _Rule(bool(needs_seal)) if needs_seal is not None else _rule(path)
    if place is None:
        if rule.needs_seal:
            raise damaged(path, "is damaged (its checksum is missing)")
        return
    begin = place + len(_MARK)
    if content[begin : begin + len(_ZEROS)] != _digest(content, place).encode():
        raise damaged(path, "is damaged (its checksum differs)")
    named = _identity(content, place)
    is_foreign = rule.identity is not None and named != rule.identity and (named or rule.needs_identity)
    if is_foreign and path.name != ENVIRONMENT:
        raise damaged(path, "is a file of another study")


def _identity(content: bytes | mmap.mmap, place: int) -> str:
    match = _IDENTITY.match(content, place + len(_MARK) + len(_ZEROS))
    return match[1].decode() if match else ""


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
