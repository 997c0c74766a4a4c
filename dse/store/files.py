"""Write files and folders whole or not at all, and lock a study's folder for one process."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import hashlib
import itertools
import json
import os
import secrets
import shutil
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from dse.store.book import BOOK, COPY, Book, digests_of
from dse.store.errors import InUse, StoreError, check_kind, damaged, no_space, unreadable
from dse.store.plain import plain

TEMPORARY = ".writing-"
"""Begins the names of files and folders that are being written."""
COORDINATORS = "coordinators"
"""Folder of a study that has a folder of each coordinator, which it locks (`dse.study.claim`)."""
_GLANCES, _GLANCE_S = 4, 0.05  # times that a lock is asked for, and between them
_DEEPEST = 3  # folders of a study above a file that its book knows
_DIFFERS = "is not what was written (its checksum differs)"


@contextlib.contextmanager
def explained(path: Path) -> Iterator[None]:
    """Turn an OSError of the block into a StoreError about `path`."""
    try:
        yield
    except OSError as error:
        reason = os.strerror(error.errno) if error.errno else str(error)
        full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
        hint = no_space() if full else ""
        raise StoreError(f"{path}: cannot be written: {reason}{hint}") from error


@contextlib.contextmanager
def exclusive(folder: Path, *, is_alone: bool = True) -> Iterator[None]:
    """Lock a study folder for this process; the system releases the lock when the process ends.

    Args:
        folder: of the study, which is made where there is none.
        is_alone: whether no coordinator may work on the study; one that does takes the lock itself.

    Raises:
        InUse: another process has the lock, or a coordinator works on the study.
        StoreError: the folder cannot be made, or its name is not UTF-8, as tables need.
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
                raise InUse(f"{folder}: another process is running this study") from None
            except OSError as error:
                if path != folder:
                    text = f"cannot be locked ({error.strerror}); use a --results folder on another disk"
                    raise StoreError(f"{folder}: {text}") from None
        if is_alone and living(folder):
            raise InUse(f"{folder}: another process is running this study")
        yield


def living(folder: Path) -> list[str]:
    """Return the names of the coordinators that work on a study now."""
    return [own.name for own in (folder / COORDINATORS).glob("*") if is_held(own) is not False]


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
    """Lock an open file; who looks whether it is locked (`is_held`) has it for an instant."""
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


@contextlib.contextmanager
def noted(path: Path) -> Iterator[Path]:
    """Do as `published`, for a file whose digest the book of its study notes.

    Raises:
        StoreError: the disk is full, read-only, or fails otherwise.
    """
    home, name = _home(path)
    with published(path) as temporary:
        yield temporary
        if home is not None:
            digest = checksum(temporary)
            before = next(iter(digests_of(home, name)), "")
            with Book(home, writes=True, is_checked=True) as book:
                book.put("file", [{"name": name, "sha256": digest, "before": before}])
    if home is not None:
        with Book(home, writes=True, is_checked=True) as book:
            book.put("file", [{"name": name, "sha256": digest, "before": ""}])


def back_up(book: Book) -> None:
    """Write the copy of a book.

    Raises:
        StoreError: the disk is full, read-only, or fails otherwise.
    """
    with published(book.folder / COPY) as temporary:
        book.write_to(temporary)


def _home(path: Path) -> tuple[Path | None, str]:
    """Return the folder of the study that a file is in, and its name there; None: it is in no study."""
    for folder in path.parents[:_DEEPEST]:
        if (folder / BOOK).is_file():
            return folder, path.relative_to(folder).as_posix()
    return None, path.name


def known_as(path: Path) -> tuple[str, ...]:
    """Return the digests that a file may have by the book of its study; none: the book has none."""
    home, name = _home(path)
    return () if home is None else digests_of(home, name)


def write_text(path: Path, text: str) -> None:
    """Replace a text file."""
    with noted(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def read_bytes(path: Path) -> bytes:
    """Return the content of a file of a study, or of any file that no book knows.

    Raises:
        Damaged: the file is missing, or its content is not what was written.
        StoreError: it cannot be read now, such as for lack of file descriptors.
    """
    try:
        check_kind(path)
        content = path.read_bytes()
    except OSError as error:
        raise unreadable(path, error) from None
    if (expected := known_as(path)) and hashlib.sha256(content).hexdigest() not in expected:
        raise damaged(path, _DIFFERS)
    return content


def verify(path: Path) -> None:
    """Check that a file of any size is what was written, as far as the book of its study knows it.

    Raises:
        Damaged, StoreError: as in `read_bytes`.
    """
    try:
        check_kind(path)
        if (expected := known_as(path)) and checksum(path) not in expected:
            raise damaged(path, _DIFFERS)
    except OSError as error:
        raise unreadable(path, error) from None


def read_text(path: Path) -> str:
    """Return the text of a file.

    Raises:
        Damaged: it is missing, or not what was written.
        StoreError: it cannot be read now.
    """
    try:
        return read_bytes(path).decode("utf-8")
    except UnicodeDecodeError as error:
        raise damaged(path, f"cannot be read: {error}") from None


def write_json(path: Path, document: Mapping[str, Any] | Sequence[Any]) -> None:
    """Replace a JSON file. NaN and infinities are written as Python's json does.

    Raises:
        TypeError: the document holds something that JSON cannot hold.
    """
    write_text(path, json.dumps(document, indent=1, default=plain) + "\n")


def read_json(path: Path) -> Any:
    """Return the document of a JSON file.

    Raises:
        Damaged: it is missing, or not what was written.
        StoreError: it cannot be read now.
    """
    try:
        return json.loads(read_bytes(path))
    except (ValueError, RecursionError) as error:
        raise damaged(path, f"cannot be read: {error}") from None


def checksum(path: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def set_aside(folder: Path, path: Path) -> None:
    """Move what lies in a study's folder to beside where it lay, under a name that nothing reads."""
    first, *rest = path.relative_to(folder).parts
    for n in itertools.count():
        top = folder / f"{first}.damaged{n or ''}"
        place = top.joinpath(*rest)
        if not os.path.lexists(place) and (not os.path.lexists(top) or top.is_dir()):
            with explained(place):
                place.parent.mkdir(parents=True, exist_ok=True)
                path.replace(place)
            return
