"""Notes and pins on designs, in the book of the study, also while the study runs."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dse import store

if TYPE_CHECKING:
    import pandas

LONGEST = 2000
"""Characters of a note."""
MOST = 10_000
"""Notes of a study."""


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


def of(folder: Path) -> list[Note]:
    """Return the notes of a study, pinned ones first, then by design.

    Raises:
        Damaged: its book is not what was written.
        StoreError: it cannot be read now.
    """
    if not (folder / store.BOOK).exists():
        return []
    with store.Book(folder) as book:
        notes = [Note(**{**row, "pinned": bool(row["pinned"])}) for row in book.rows("note")]
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
    with store.Book(folder, writes=True) as book:
        with book.together():
            book.drop("note", "trial = ? AND point IS ?", trial, point)
            if text or pinned:
                at = datetime.now(UTC).isoformat(timespec="seconds")
                book.put("note", [asdict(Note(trial, point, text, pinned, at))])
            if len(book.rows("note")) > MOST:
                raise store.StoreError(f"{folder}: a study has at most {MOST} notes")
        store.back_up(book)
    return of(folder)


def with_notes(rows: pandas.DataFrame, folder: Path) -> pandas.DataFrame:
    """Return rows with columns `note` and `pinned`: of the point, else of its trial.

    Raises:
        StoreError: as in `of`.
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
