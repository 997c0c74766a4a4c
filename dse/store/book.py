"""The book of a study: one SQLite file, `study.sqlite`, that says all that its arrays and tables do not.

    study   documents of the study by name: its sessions, warnings, audit, the rounds of racing
    trial   the designs, in the order in which they were proposed, and how each ended
    queue   designs that a user wants trained next
    file    SHA-256 of every other file of the folder
    claim   which coordinator trains a run

Every change is a transaction, so a process that is killed leaves no half of one. Every row has a digest of
its cells, so a row that the disk has changed is not believed.

While a study runs on a disk of its machine, the book has a write-ahead log: a change costs one flush. At the
end, and on file systems that machines share, it has a rollback journal: it is one file that can be copied, be
read on a read-only disk, and be shared over NFS with locks.

A file that is replaced has two digests in the book until it is renamed into place, the one that it will have
and the one that it has: so it is known at any moment.

A copy of the book, `study.sqlite.copy`, is written whenever the tables are: one that a disk has damaged is
restored from it (`dse.study.mended`).
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import sqlite3
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from dse.store.errors import StoreError, check_kind, damaged, no_space, unreadable
from dse.store.plain import plain

BOOK, COPY = "study.sqlite", "study.sqlite.copy"
_WAIT_S = 60.0
# Table -> its columns, and how many of these are the key. Other columns than numbers and texts hold JSON.
_TABLES: Mapping[str, tuple[tuple[str, ...], int]] = {
    "study": (("name", "content"), 1),
    "trial": (
        (
            "trial",
            "batch",
            "design",
            "proposed_s",
            "enqueued",
            "reported_s",
            "objectives",
            "excluded",
            "more",
        ),
        1,
    ),
    "queue": (("place", "design"), 1),
    "file": (("name", "sha256", "before"), 1),
    "claim": (("trial", "repeat", "coordinator"), 2),
}
_JSON = frozenset({"content", "design", "objectives", "more"})


class Book:
    """The book of the study in a folder, open until `close` or the end of a `with`.

    Args:
        folder: of the study.
        name: of the file.
        writes: whether it is written; it is then made where there is none.
        is_checked: whether somebody has checked its structure already.
        is_session: whether many changes follow.

    Raises:
        Damaged: it is missing, or not what was written.
        StoreError: it cannot be opened now.
    """

    def __init__(
        self,
        folder: Path,
        name: str = BOOK,
        *,
        writes: bool = False,
        is_checked: bool = False,
        is_session: bool = False,
    ) -> None:
        self.folder, self.path = folder, folder / name
        self._depth, self._is_session = 0, is_session and _is_local(folder)
        if not writes or os.path.lexists(self.path):
            try:
                check_kind(self.path)
            except OSError as error:
                raise unreadable(self.path, error) from None
        if writes and self._has_log() and not _is_local(folder):
            raise StoreError(f"{self.path}: a process of the machine with its disk writes it; go on there")
        with self._explained():
            self._db = _connected(self.path, "mode=rwc" if writes else "mode=ro")
        try:
            with self._explained():
                if writes:
                    if self._is_session:
                        self._db.execute("PRAGMA journal_mode=WAL")
                    self._make()
                if not is_checked:
                    self._check()
        except BaseException:
            self.close()
            raise

    def _has_log(self) -> bool:
        """Return whether it has a write-ahead log now.

        The file itself is not opened for this: closing it would drop the locks that this process has on it.
        """
        return os.path.lexists(f"{self.path}-wal")

    def _make(self) -> None:
        tables = ", ".join(f"'{name}'" for name in _TABLES)
        n_tables = self._db.execute(f"SELECT count(*) FROM sqlite_master WHERE name IN ({tables})")
        if n_tables.fetchone()[0] < len(_TABLES):
            with self.together():
                for name, (columns, n_key) in _TABLES.items():
                    key = ", ".join(columns[:n_key])
                    place = "" if n_key > 1 or columns[0] == "name" else " INTEGER"
                    cells = ", ".join(
                        [f"{columns[0]}{place}", *columns[1:], "digest", f"PRIMARY KEY ({key})"]
                    )
                    self._db.execute(f"CREATE TABLE IF NOT EXISTS {name} ({cells})")

    def _check(self) -> None:
        """Check the structure of the file, unless this process has done so since it was last written."""
        with contextlib.suppress(OSError):
            now: tuple[str | int, ...] = (str(self.path.absolute()), *_state(self.path))
            if now in _CHECKED:
                return
            fault = self._db.execute("PRAGMA quick_check(1)").fetchone()[0]
            if fault != "ok":
                raise damaged(self.path, f"is damaged ({' '.join(str(fault).split())})")
            for name in _TABLES:
                self._db.execute(f"SELECT 1 FROM {name} LIMIT 1")
            if len(_CHECKED) > _MOST_CHECKED:
                _CHECKED.clear()
            _CHECKED.add(now)

    @contextlib.contextmanager
    def _explained(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.Error as error:
            raise _said(self.path, error) from None

    def close(self) -> None:
        """Close the file."""
        if self._is_session:
            with contextlib.suppress(sqlite3.Error):  # another process has it open
                self._db.execute("PRAGMA busy_timeout=0")
                self._db.execute("PRAGMA journal_mode=DELETE")
        self._db.close()

    def __enter__(self) -> Book:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @contextlib.contextmanager
    def together(self) -> Iterator[None]:
        """Make all changes of the block at once, or none of them where it raises."""
        self._depth += 1
        try:
            with self._explained():
                if self._depth == 1:
                    self._db.execute("BEGIN IMMEDIATE")
            try:
                yield
            except BaseException:
                if self._depth == 1:
                    with contextlib.suppress(sqlite3.Error):
                        self._db.execute("ROLLBACK")
                raise
            with self._explained():
                if self._depth == 1:
                    try:
                        self._db.execute("COMMIT")
                    except sqlite3.Error:
                        with contextlib.suppress(sqlite3.Error):
                            self._db.execute("ROLLBACK")
                        raise
        finally:
            self._depth -= 1

    def put(self, table: str, rows: Iterable[Mapping[str, Any]]) -> None:
        """Write rows, in place of those with the same key."""
        columns, _ = _TABLES[table]
        cells = [[_cell(name, row[name]) for name in columns] for row in rows]
        marks = ", ".join("?" * (len(columns) + 1))
        with self.together(), self._explained():
            self._db.executemany(
                f"INSERT OR REPLACE INTO {table} VALUES ({marks})",
                [[*row, _digest(table, row)] for row in cells],
            )

    def rows(self, table: str, where: str = "", *values: object) -> list[dict[str, Any]]:
        """Return the rows of a table by key; `where`: a condition of SQL with its values.

        Raises:
            Damaged: a row is not what was written.
        """
        columns, n_key = _TABLES[table]
        names, key = ", ".join(columns), ", ".join(columns[:n_key])
        condition = f"WHERE {where}" if where else ""
        with self._explained():
            found = self._db.execute(
                f"SELECT {names}, digest FROM {table} {condition} ORDER BY {key}", values
            ).fetchall()
        rows = []
        for *cells, digest in found:
            if digest != _digest(table, cells):
                raise damaged(self.path, f"is damaged (a row of table {table} is not what was written)")
            rows.append(_row(columns, cells))
        return rows

    def drop(self, table: str, where: str = "1", *values: object) -> None:
        """Remove rows of a table, all without a condition."""
        with self.together(), self._explained():
            self._db.execute(f"DELETE FROM {table} WHERE {where}", values)

    def everything(self) -> dict[str, list[dict[str, Any]]]:
        """Return table -> its rows.

        Raises:
            Damaged: a row is not what was written.
        """
        return {table: self.rows(table) for table in _TABLES}

    def version(self) -> int:
        """Return a number that is another one once somebody else has written the book."""
        with self._explained():
            return int(self._db.execute("PRAGMA data_version").fetchone()[0])

    def write_to(self, path: Path) -> None:
        """Write all of it to another file, which is not there yet."""
        with self._explained():
            self._db.execute("VACUUM INTO ?", (str(path),))

    def document(self, name: str, default: Any = None) -> Any:
        """Return a document of the study, as JSON holds it; `default` where there is none."""
        found = self.rows("study", "name = ?", name)
        return found[0]["content"] if found else default

    def keep(self, name: str, content: Any) -> None:
        """Write a document of the study; None removes it."""
        if content is None:
            self.drop("study", "name = ?", name)
        else:
            self.put("study", [{"name": name, "content": content}])


_CHECKED: set[tuple[str | int, ...]] = set()
_MOST_CHECKED = 1000
_READ_ONLY = (sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_READONLY)
_SHARED = ("nfs", "cifs", "smb", "9p", "fuse", "lustre", "gpfs", "beegfs", "ceph", "afs", "gfs2", "ocfs2")
"""Beginnings of the names of file systems that several machines may share."""


def _connected(path: Path, mode: str) -> sqlite3.Connection:
    """Return a connection to a database; one with a log on a read-only disk is read as it is."""
    place = path.absolute().as_uri()
    database = sqlite3.connect(
        f"{place}?{mode}", timeout=_WAIT_S, isolation_level=None, uri=True, check_same_thread=False
    )
    if mode == "mode=ro":
        try:
            database.execute("SELECT 1 FROM sqlite_master LIMIT 1")
        except sqlite3.OperationalError as error:
            if getattr(error, "sqlite_errorcode", 0) & 0xFF not in _READ_ONLY:
                return database  # which who reads it says
            database.close()
            database = sqlite3.connect(f"{place}?immutable=1", isolation_level=None, uri=True)
    return database


def _is_local(folder: Path) -> bool:
    """Return whether a folder is on a disk of this machine, as far as the system tells."""
    kinds: dict[str, str] = {}
    with contextlib.suppress(OSError):
        for line in Path("/proc/self/mounts").read_text(encoding="utf-8", errors="replace").splitlines():
            _, place, kind, *_ = line.split()
            kinds[place] = kind
    real = folder.resolve()
    kind = next((kinds[str(place)] for place in (real, *real.parents) if str(place) in kinds), "nfs")
    return not kind.startswith(_SHARED)


def _digest(table: str, cells: Sequence[object]) -> str:
    return hashlib.sha256(json.dumps([table, *cells]).encode()).hexdigest()[:16]


def _cell(name: str, value: Any) -> Any:
    """Return a value as SQLite gives it back."""
    if name in _JSON:
        return json.dumps(value, default=plain)
    return int(value) if isinstance(value, bool) else value


def _row(columns: Sequence[str], cells: Sequence[Any]) -> dict[str, Any]:
    named = zip(columns, cells, strict=True)
    return {name: json.loads(cell) if name in _JSON else cell for name, cell in named}


def _said(path: Path, error: sqlite3.Error) -> StoreError:
    """Return the error of SQLite about a book as one sentence."""
    code = getattr(error, "sqlite_errorcode", 0) & 0xFF
    text = next(iter(str(error).splitlines()), "") or type(error).__name__
    if code == sqlite3.SQLITE_READONLY:
        return StoreError(f"{path}: cannot be written: Read-only file system")
    if code in (sqlite3.SQLITE_FULL, sqlite3.SQLITE_TOOBIG):
        return StoreError(f"{path}: cannot be written: {text}{no_space()}")
    if code in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB) or isinstance(error, sqlite3.ProgrammingError):
        return damaged(path, f"is damaged ({text})")
    if code == sqlite3.SQLITE_ERROR and text.startswith("no such"):
        return damaged(path, "is damaged (it has no such table)")
    if code == sqlite3.SQLITE_BUSY:
        return StoreError(f"{path}: another process writes it; try again")
    if code == sqlite3.SQLITE_IOERR:
        return StoreError(f"{path}: cannot be read or written: {text}{no_space()}")
    return StoreError(f"{path}: cannot be read or written: {text}")


def document(folder: Path, name: str, default: Any = None) -> Any:
    """Return a document of the study in a folder; `default` where there is none, or no book.

    Raises:
        Damaged, StoreError: the book cannot be read.
    """
    if not os.path.lexists(folder / BOOK):
        return default
    with Book(folder) as book:
        return book.document(name, default)


def keep(folder: Path, name: str, content: Any) -> None:
    """Write a document of the study in a folder; None removes it."""
    with Book(folder, writes=True) as book:
        book.keep(name, content)


_KNOWN: dict[str, tuple[tuple[int, ...], dict[str, tuple[str, ...]]]] = {}
_RECENT_NS = 1_000_000_000  # a book that was written so shortly ago is written again soon


def digests(folder: Path) -> Mapping[str, tuple[str, ...]]:
    """Return name -> the digests that a file of a study may have: the one it has, or is about to have.

    Empty where there is no book, or it cannot be read: what it says of the files is then not known.
    """
    try:
        state = _state(folder / BOOK)
        key = str(folder.absolute())
        if key not in _KNOWN or _KNOWN[key][0] != state:
            with Book(folder) as book:
                rows = book.rows("file")
            _KNOWN[key] = state, {row["name"]: _of_file(row) for row in rows}
    except (OSError, StoreError):
        return {}
    return _KNOWN[key][1]


def digests_of(folder: Path, name: str) -> tuple[str, ...]:
    """Return the digests that one file may have, as in `digests`; of a book that is being written, alone."""
    try:
        state, known = _state(folder / BOOK), _KNOWN.get(str(folder.absolute()))
        if (known is not None and known[0] == state) or time.time_ns() - state[-1] > _RECENT_NS:
            return digests(folder).get(name, ())
        with Book(folder, is_checked=True) as book:
            rows = book.rows("file", "name = ?", name)
    except (OSError, StoreError):
        return ()
    return _of_file(rows[0]) if rows else ()


def _state(path: Path) -> tuple[int, ...]:
    """Return what differs when a book has been written; the last is when that was, in nanoseconds."""
    status = path.stat()
    state: tuple[int, ...] = (status.st_ino, status.st_size, status.st_mtime_ns)
    with contextlib.suppress(OSError):
        log = path.with_name(f"{path.name}-wal").stat()
        state = (*state, log.st_ino, log.st_size, log.st_mtime_ns)
    return state


def _of_file(row: Mapping[str, str]) -> tuple[str, ...]:
    return tuple(filter(None, (row["sha256"], row["before"])))
