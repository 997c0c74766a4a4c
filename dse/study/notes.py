"""Notes and pins on designs: a file of the study, written whole or not at all, also while the study runs."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dse import store

if TYPE_CHECKING:
    import pandas

FILE = "notes.json"
LONGEST = 2000
"""Characters of a note."""
MOST = 10_000
"""Notes of a study."""
_LOCK = ".notes.lock"


@dataclass(frozen=True)
class Note:
    """What somebody wrote on a design.

    trial: number of the design. point: number of one of its points, None: of all of them.
    text: may be '' for a pin alone. pinned: whether it is to be seen first. at: ISO 8601, UTC.
    """

    trial: int
    point: int | None
    text: str
    pinned: bool
    at: str

    @property
    def design(self) -> str:
        """Its name on the command line: 3, or 3.12 for a point."""
        return str(self.trial) if self.point is None else f"{self.trial}.{self.point}"


def parse_design(text: str) -> tuple[int, int | None]:
    """Return trial and point of '3' or '3.12'.

    Raises:
        StoreError: it is neither.
    """
    trial, dot, point = text.partition(".")
    if not all(
        part.isascii() and part.isdecimal() and len(part) < 10 for part in (trial, *([point] * len(dot)))
    ):
        raise store.StoreError(
            f"DESIGN must be a trial such as 3, or a point of one such as 3.12, got '{text}'"
        )
    return int(trial), int(point) if dot else None


def read(path: Path) -> list[Note]:
    """Return the notes of a file.

    Raises:
        Damaged: it is not what was written.
        StoreError: it cannot be read now.
    """
    document = store.read_json(path)
    try:
        return [Note(**note) for note in document]
    except TypeError:
        raise store.damaged(path, "holds no notes") from None


def of(folder: Path) -> list[Note]:
    """Return the notes of a study, pinned ones first, then by design.

    Raises:
        StoreError: as in `read`.
    """
    path = folder / FILE
    notes = read(path) if path.exists() else []
    return sorted(
        notes, key=lambda note: (not note.pinned, note.trial, -1 if note.point is None else note.point)
    )


def write(folder: Path, trial: int, point: int | None, text: str, pinned: bool) -> list[Note]:
    """Replace the note on a design; one without text and pin is removed. Return the notes of the study.

    Raises:
        StoreError: the study has no such design, the note is too long or one too many, or the file is damaged
            or cannot be written.
    """
    text = text.strip()
    if len(text) > LONGEST:
        raise store.StoreError(f"a note must have at most {LONGEST} characters, got {len(text)}")
    if not _has(folder, trial, point):
        design = f"trial {trial}" if point is None else f"point {point} of trial {trial}"
        raise store.StoreError(f"{folder}: has no {design}")
    with locked(folder):
        notes = [note for note in of(folder) if (note.trial, note.point) != (trial, point)]
        if text or pinned:
            at = datetime.now(UTC).isoformat(timespec="seconds")
            notes.append(Note(trial, point, text, pinned, at))
        if len(notes) > MOST:
            raise store.StoreError(f"{folder}: a study has at most {MOST} notes")
        store.write_json(folder / FILE, [asdict(note) for note in notes])
    return of(folder)


def with_notes(rows: pandas.DataFrame, folder: Path) -> pandas.DataFrame:
    """Return rows with columns `note` and `pinned`: of the point, else of its trial.

    Raises:
        StoreError: as in `read`.
    """
    known = {(note.trial, note.point): note for note in of(folder)}
    points = rows["point"] if "point" in rows else [None] * len(rows)
    notes = [
        known.get((int(trial), None if point is None else int(point)), known.get((int(trial), None)))
        for trial, point in zip(rows["trial"], points, strict=True)
    ]
    return rows.assign(
        note=[note.text if note else "" for note in notes],
        pinned=[bool(note and note.pinned) for note in notes],
    )


def plain(folder: Path) -> list[dict[str, Any]]:
    """Return the notes of a study as JSON holds them; none where they cannot be read."""
    try:
        return [asdict(note) for note in of(folder)]
    except store.StoreError:
        return []


def _has(folder: Path, trial: int, point: int | None) -> bool:
    import pandas

    path = folder / ("trials.parquet" if point is None else "points.parquet")
    if not path.is_file():
        return False
    where = [("trial", "==", trial), *([] if point is None else [("point", "==", point)])]
    store.verify(path)
    return len(pandas.read_parquet(path, columns=["trial"], filters=where)) > 0


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Wait for the other writers of notes and views; the study itself may run."""
    with store.explained(folder / FILE):
        handle = os.open(folder / _LOCK, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX)
            yield
        finally:
            os.close(handle)
