"""The front of studies or tables, with all that can be asked for: chips, duty, uncertain numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dse import store
from dse.skyline import front
from dse.skyline.admissible import DECIDING, meeting
from dse.skyline.constraints import ExpressionError, conditions_of, named_columns
from dse.skyline.front import Skyline
from dse.skyline.table import Goal
from dse.study import corrected, held
from dse.study.question import CERTAINTY, DRAWS, Question
from dse.study.results import open as open_study

if TYPE_CHECKING:
    import pandas

_IN_MEMORY = 4_000_000  # rows of a table that is read whole

ADDED = ("target", "ram_bytes", "cycles", "power_mw", *CERTAINTY)
"""Columns of a front that are there because they were asked for."""


def measured(rows: pandas.DataFrame, names: Sequence[str]) -> list[str]:
    """Return the columns of measured numbers to show: what an accuracy is worth comes before it.

    An energy flat out has the one at the sensor's period beside it: they may differ by a factor of 10^5.
    """
    shown: list[str] = []
    for name in names:
        beside = [f"{name}_test", *(["energy_throttled_uj"] if name == "energy_uj" else [])]
        beside = [x for x in beside if x in rows and rows[x].notna().any()]
        shown += [*(x for x in [f"{name}_corrected"] if x in rows), name, *beside]
    return list(dict.fromkeys(shown))


def front_of(
    results: Sequence[str | Path],
    question: Question = Question(),  # noqa: B008 (frozen)
) -> Skyline:
    """Return the non-dominated points, and notes on what was left out.

    Args:
        results: folders of studies, or CSV, Parquet or JSON tables, which are concatenated.
        question: what is asked; conditions on front_share and front_probability hold for points of the front.

    Raises:
        ExpressionError: an unknown column or direction, a condition that cannot be read, or a confidence
            where nothing has a probability.
        TableError: a table cannot be read.
    """
    import pandas

    objectives, by = question.goals(results[0]), question.groups
    if (large := _large(results, question)) is not None:
        rows, notes = _of_large(large, objectives, question.where, by)
        lacking = corrected.lacking(rows, (name for name, _ in objectives))
        return Skyline(rows, [*notes, *lacking, *held.remarks(Path(results[0]))])
    frames = question.points(results)
    frame = pandas.concat(frames, ignore_index=True)
    conditions = conditions_of(question.where)
    certain = [x for x in conditions if named_columns([x]) & set(CERTAINTY)]
    early = [x for x in conditions if x not in certain]
    if question.confidence is not None:
        certain.append(f"front_probability >= {question.confidence}")
    rows, notes = front.skyline(frame, objectives, early, by, question.oversize)
    lacking = corrected.lacking(rows, (name for name, _ in objectives))
    notes = [*notes, *lacking, *(text for path in results for text in held.remarks(Path(path)))]
    if question.draws or certain:
        from dse.study import resampling

        among = front.comparable(frame, objectives, early, by, oversize=question.oversize).rows
        shares, remarks = resampling.certainty(
            results, frames, question.hardware, objectives, question.draws or DRAWS, among, by
        )
        rows = rows.assign(**{name: share[rows.index] for name, share in shares.items()})
        notes += remarks
    if question.confidence is not None and "front_probability" not in rows:
        raise ExpressionError("confidence needs studies with an accuracy among the objectives")
    if certain:
        n_all = len(rows)
        rows = rows[meeting(rows, certain)]
        notes.append(f"{n_all - len(rows)} of {n_all} points of the front are on it with less confidence")
    if question.targets:
        from dse.deploy.footprints import on_targets

        rows, remarks = on_targets(open_study(results[0]), rows, question.targets)
        notes += remarks
    return Skyline(rows, notes)


def _large(results: Sequence[str | Path], question: Question) -> Path | None:
    """Return the file of a table that is too large for memory, if its front needs nothing but its columns."""
    import pyarrow.parquet

    path = Path(results[0])
    file = path / "points.parquet" if path.is_dir() else path
    asks = replace(question, objectives=None, where=(), by=()) != Question()
    if len(results) > 1 or asks or file.suffix != ".parquet" or not file.is_file():
        return None
    try:
        n_rows = pyarrow.parquet.read_metadata(file).num_rows
    except (OSError, ValueError):  # the reader of tables says why
        return None
    return file if n_rows > _IN_MEMORY else None


def _of_large(path: Path, goals: Sequence[Goal], where: Sequence[str], by: Sequence[str]) -> Skyline:
    """Return the front of a Parquet file, of which only the columns that decide it are read whole.

    Raises:
        ExpressionError: as in `front_of`.
        StoreError: the file is no longer what dse has written.
    """
    import pyarrow.parquet

    store.verify(path)
    with pyarrow.parquet.ParquetFile(path) as file:
        needed = {*(name for name, _ in goals), *named_columns(where), *by, *DECIDING}
        deciding = file.read([name for name in file.schema_arrow.names if name in needed])
        found = front.skyline(deciding.to_pandas(), goals, where, by)
        places = np.sort(found.rows.index.to_numpy())
        parts, start = [], 0
        for batch in file.iter_batches():
            here = places[(places >= start) & (places < start + batch.num_rows)] - start
            parts.append(batch.take(pyarrow.array(here)))
            start += batch.num_rows
    rows: pandas.DataFrame = pyarrow.Table.from_batches(parts).to_pandas().set_axis(places)
    return Skyline(rows.loc[found.rows.index], found.notes)
