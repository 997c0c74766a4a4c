"""Two studies, or tables of design points, side by side: what may be compared, and the comparison."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dse import registry
from dse.skyline.compare import Comparison, compare
from dse.skyline.constraints import ExpressionError
from dse.skyline.table import Goal
from dse.study import held
from dse.study.question import Question
from dse.study.results import open as open_study

if TYPE_CHECKING:
    import pandas

_RECORDINGS = ("data", "window", "split")
"""Sections of a search space that say which recordings an accuracy is of."""


def compare_studies(
    first: str | Path,
    second: str | Path,
    question: Question = Question(),  # noqa: B008 (frozen)
) -> tuple[Comparison, dict[str, pandas.DataFrame], list[Goal]]:
    """Compare two studies.

    Args:
        first: folder of a study, or CSV, Parquet or JSON table.
        second: the same.
        question: without objectives, those of the studies, which must be the same; conditions are for the
            points of both.

    Returns:
        The comparison, the points that it is of by the name of their study, and the objectives.

    Raises:
        ExpressionError: the two cannot be compared: other objectives, tasks or hardware; or a column or
            condition is wrong.
        StoreError, TableError: one cannot be read.
    """
    paths = [Path(first), Path(second)]
    goals = question.goals(first) if question.objectives else _objectives(paths)
    frames = question.points(paths)
    for path, frame in zip(paths, frames, strict=True):
        if lacks := [name for name, _ in goals if name not in frame or not frame[name].notna().any()]:
            raise ExpressionError(f"{path}: has no numbers of {lacks[0]}; both must have every objective")
    names = _names(paths)
    notes = [text for path in paths for text in held.remarks(path)]
    by = ["task"]
    if any(name in registry.columns("hardware") for name, _ in goals):
        by.append("hardware")
    for column in by:
        frames, note = _common(column, frames, names)
        notes += note
    tables = dict(zip(names, frames, strict=True))
    result = compare(tables, goals, question.where)
    all_notes = [*_other_recordings(paths), *result.notes, *notes]
    return Comparison(result.summary, result.front, result.gains, all_notes), tables, goals


def _objectives(paths: Sequence[Path]) -> list[Goal]:
    """Return the objectives of the studies among some paths."""
    known = {path: open_study(path).objectives for path in paths if path.is_dir()}
    if not known:
        raise ExpressionError(
            "tables have no objectives of their own; state them: --objectives accuracy:max,..."
        )
    different = list({tuple(sorted(goals)): path for path, goals in known.items()}.values())
    if len(different) > 1:
        texts = [f"{path} has {', '.join(f'{a}:{b}' for a, b in known[path])}" for path in known]
        raise ExpressionError(f"the objectives differ: {'; '.join(texts)}; state common ones: --objectives")
    return next(iter(known.values()))


def _names(paths: Sequence[Path]) -> list[str]:
    """Return the names of folders or files; the paths where these are the same."""
    names = [path.resolve().name if path.is_dir() else path.stem for path in paths]
    if names[0] != names[1]:
        return names
    texts = [str(path) for path in paths]
    return texts if texts[0] != texts[1] else [f"{texts[0]} (1)", f"{texts[1]} (2)"]


def _common(
    column: str, frames: list[pandas.DataFrame], names: Sequence[str]
) -> tuple[list[pandas.DataFrame], list[str]]:
    """Return the rows with values of a column that both tables have, and a note on the others."""
    values = [[str(x) for x in frame[column].unique()] if column in frame else [] for frame in frames]
    if not any(values):
        return frames, []
    common = [value for value in values[0] if value in values[1]]
    if not common:
        has = [f"{name}: {', '.join(of) or 'none'}" for name, of in zip(names, values, strict=True)]
        remedy = "; --hardware NAME computes costs of both on one" if column == "hardware" else ""
        raise ExpressionError(f"the studies have no {column} in common ({'; '.join(has)}){remedy}")
    alone = [
        f"{value} ({name})"
        for name, of in zip(names, values, strict=True)
        for value in of
        if value not in common
    ]
    kept = [frame[np.isin(frame[column].astype(str), common)] for frame in frames]
    return kept, [f"{column} of one study alone is left out: {', '.join(alone)}"] if alone else []


def _other_recordings(paths: Sequence[Path]) -> list[str]:
    """Return a note if accuracies are of other recordings."""
    if not all(path.is_dir() for path in paths):
        return []
    spaces = [open_study(path).space for path in paths]
    differ = [name for name in _RECORDINGS if spaces[0].get(name) != spaces[1].get(name)]
    return (
        [f"the studies differ in {', '.join(differ)}: their accuracies are of other recordings"]
        if differ
        else []
    )
