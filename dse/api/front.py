"""The front of studies or tables, with all that can be asked for: chips, duty, uncertain numbers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from dse.skyline import front
from dse.skyline.admissible import meeting
from dse.skyline.constraints import ExpressionError, conditions_of, named_columns
from dse.skyline.front import Skyline
from dse.study import corrected, held
from dse.study.question import CERTAINTY, DRAWS, Question
from dse.study.results import open as open_study

if TYPE_CHECKING:
    import pandas


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
        results: folders of studies, or CSV, Parquet or JSON tables; column `study` says which of several a
            point is from.
        question: what is asked; conditions on front_share and front_probability hold for points of the front.

    Raises:
        ExpressionError: an unknown column or direction, a condition that cannot be read, or a confidence
            where nothing has a probability.
        TableError: a table cannot be read.
    """
    import pandas

    objectives, by = question.goals(results[0]), question.groups
    frames = question.points(results)
    if len(results) > 1:  # a copy is in one piece: pandas warns where a column is added to many
        frames = [x.copy().assign(study=str(path)) for path, x in zip(results, frames, strict=True)]
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

        study = open_study(results[0])
        rows, remarks = on_targets(study, rows, question.targets, question.hardware)
        notes += remarks
    return Skyline(rows, notes)
