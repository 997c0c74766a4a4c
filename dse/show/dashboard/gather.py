"""The content of a page, as plain values: points, fronts, intervals, and notes about them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas

from dse.base.records import Array
from dse.show.dashboard.budgets import contenders, gather_budgets
from dse.show.dashboard.definition import Definition, definition_for, load
from dse.show.figures.front import design_columns, interval, numbers
from dse.show.figures.importance import gather_importance
from dse.show.figures.labels import OKABE_ITO_DARK, OKABE_ITO_LIGHT, label, short
from dse.skyline.admissible import admissible, fitting, honest
from dse.skyline.front import front_mask
from dse.skyline.table import group_numbers
from dse.store import plain_cell

MAX_POINTS = 12_000
"""Largest number of points in a page. A larger table is thinned: the page holds every front point, and an
even sample of the others.

With sixty columns the file then has some 7 MB, 5 of them the drawing library."""

ENERGY, INSTEAD = "energy_uj", "energy_throttled_uj"
"""Energy of an inference computed flat out, and that at the sensor's period, idle time included."""

_BOOKKEEPING = ("status", "reason")


def gather_page(
    frame: pandas.DataFrame,
    *,
    name: str,
    objectives: Mapping[str, str] | Sequence[tuple[str, str]],
    notes: Sequence[str] = (),
    results: str = "RESULTS",
    hardware: Sequence[str] = (),
    definition: Definition | None = None,
    marks: Sequence[Mapping[str, Any]] = (),
) -> dict[str, Any]:
    """Gather the content of a page, as plain values that JSON can hold.

    Args:
        frame: design points and failed trials, one row each, columns as in the record of a trial. A row
            whose `status` is 'failed' is counted alone; `task` and `hardware` split the fronts.
        name: of the study.
        objectives: column -> 'max' or 'min', in the order of interest: the first is drawn upwards.
        notes: sentences to print above the figure, such as warnings of the run.
        results: what the commands that the page offers call the study: its folder.
        hardware: profiles for these commands, if they are not the profiles of the study.
        definition: which parts the page has and what it opens with; None: `dashboards/study.yaml`.
        marks: published designs to draw beside, as `dse.show.report.gather_marks` returns them.

    Returns:
        name, notes and counts of trials by status;
        state: title and text in place of a figure without points, else None;
        objectives: {column: direction} of the objectives in the table;
        columns: {column: {label, unit, values}}; `design` names the columns that define a design;
        intervals: {column: {low, high}}, distances from the value;
        unable: numbers of the rows that their hardware cannot run;
        front: numbers of the rows that no row of the same task and hardware dominates in all objectives;
        budgets: what decides fronts and picks under any limits (`budgets.gather_budgets`, `contenders`);
        period: the same page with energies at the sensor's period: `instead` takes the place of column
        `energy`; None if the table has not both;
        importance: of each parameter for each objective (`importance.gather_importance`);
        definition: parts and initial settings of the page (`definition_for`);
        marks: the argument.

    Raises:
        ValueError: a column name occurs twice, or a direction is neither 'max' nor 'min'.
    """
    if frame.columns.duplicated().any():
        raise ValueError(
            f"columns must be unique, got '{frame.columns[frame.columns.duplicated()][0]}' twice"
        )
    directions = dict(objectives)
    wrong = [
        f"'{column}': '{direction}'"
        for column, direction in directions.items()
        if direction not in ("max", "min")
    ]
    if wrong:
        raise ValueError(f"directions must be 'max' or 'min', got {', '.join(wrong)}")
    failed = _failed(frame)
    points = frame[~failed].reset_index(drop=True)
    present = {
        column: direction
        for column, direction in directions.items()
        if np.isfinite(numbers(points, column)).any()
    }
    at_period = _at_period(points, present)
    budgets = gather_budgets(points, present, results, hardware, at_period)
    several = [contenders(points, goals, budgets["maximise"]) for goals in (present, at_period)]
    deciding = np.union1d(*several).astype(int)
    keep = _kept(len(points), deciding)
    shown = points.iloc[keep]
    place = np.full(len(points), -1)
    place[keep] = np.arange(len(keep))
    measured = [
        column
        for column in map(str, points.columns)
        if column not in _BOOKKEEPING and not column.endswith(("_se", "_low", "_high"))
    ]
    exact = {*present, *budgets["columns"], *dict(budgets["ties"]), budgets["maximise"], *at_period}
    columns = {column: _column(shown, column, exact=column in exact) for column in measured}
    if at_period and ENERGY in present:
        columns[INSTEAD]["label"] = "energy at the sensor's period"
    defined, lacks = definition_for(definition or load(), columns if len(points) else {}, budgets["columns"])
    return {
        "name": name,
        "notes": [*notes, *_remarks(points, directions, present, len(keep)), *lacks],
        "counts": _counts(frame),
        "state": _state(points, failed, directions, present),
        "objectives": present,
        "design": _design(points, measured),
        "columns": columns,
        "intervals": _intervals(shown, measured),
        "unable": np.flatnonzero(_unable(points)[keep]).tolist(),
        "front": place[_front(points, present)].tolist(),
        "budgets": budgets
        | {
            "contenders": place[deciding].tolist(),
            "stands_for": (len(points) - len(deciding)) / (len(keep) - len(deciding))
            if len(keep) < len(points)
            else 1,
        },
        "period": {"energy": ENERGY, "instead": INSTEAD} if at_period else None,
        "definition": defined,
        "importance": gather_importance(points, present | at_period),
        "marks": [dict(mark) for mark in marks],
        "palette": {"light": OKABE_ITO_LIGHT, "dark": OKABE_ITO_DARK},
    }


def _design(points: pandas.DataFrame, measured: Sequence[str]) -> list[str]:
    """Return the columns that define a design; the name of a task stands for the section that defines it."""
    columns = [column for column in design_columns(points) if column in measured]
    named = {"task", "task.target"} <= set(measured)
    if not named or points.groupby("task")["task.target"].nunique().max() > 1:
        return columns
    return ["task" if column == "task.target" else column for column in columns]


def _failed(frame: pandas.DataFrame) -> Array:
    if "status" not in frame.columns:
        return np.zeros(len(frame), bool)
    return np.asarray(frame["status"].astype(str) == "failed")


def _front(points: pandas.DataFrame, objectives: Mapping[str, str]) -> Array:
    """Return the row numbers on the front over all objectives."""
    if not objectives:
        return np.zeros(0, np.int64)
    by = [column for column in ("task", "hardware") if column in points.columns]
    group, usable = group_numbers(points, by), admissible(points)
    return np.flatnonzero(front_mask(points[list(objectives)], objectives.items(), group, usable))


def _unable(points: pandas.DataFrame) -> Array:
    """Return which points their hardware cannot run; the others that it does not hold have an answer."""
    if "fits" not in points.columns:
        return np.zeros(len(points), bool)
    unable: Array = ~fitting(points) & np.asarray(points["fits"].isna())
    return unable


def _at_period(points: pandas.DataFrame, objectives: Mapping[str, str]) -> dict[str, str]:
    """Return the objectives with the energy at the sensor's period; none if the table lacks either."""
    if ENERGY not in objectives or INSTEAD in objectives or not np.isfinite(numbers(points, INSTEAD)).any():
        return {}
    return {INSTEAD if name == ENERGY else name: way for name, way in objectives.items()}


def _kept(n: int, best: Array) -> Array:
    """Return the rows in the page: all that decide a front or a pick, and an even sample of the rest."""
    if n <= MAX_POINTS:
        return np.arange(n)
    rest = np.delete(np.arange(n), best)
    # The sample is never empty, however many points are on fronts: feasible points are estimated from it.
    room = min(len(rest), max(MAX_POINTS - len(best), MAX_POINTS // 4))
    return np.sort(np.concatenate([best, rest[np.linspace(0, len(rest) - 1, room).astype(int)]]))


def _column(frame: pandas.DataFrame, column: str, *, exact: bool) -> dict[str, Any]:
    """Return a column; an exact one, which budgets are compared with, has all its digits."""
    words, unit = label(column)
    digits = 17 if exact else 6
    return {"label": words, "unit": unit, "values": _values(frame[column], digits)}


def _values(values: pandas.Series, digits: int) -> list[object]:
    """Return values as JSON holds them. The rows of a trial repeat most values: each is converted once."""
    if values.dtype.kind != "f":
        return [plain(value, digits) for value in values.tolist()]
    codes, distinct = values.factorize()
    known = [*(plain(value, digits) for value in distinct.tolist()), None]  # a missing value's code is -1
    return [known[code] for code in codes.tolist()]


def _intervals(frame: pandas.DataFrame, columns: Sequence[str]) -> dict[str, dict[str, Any]]:
    ends = {column: interval(frame, column) for column in columns}
    return {
        column: {"low": [plain(x) for x in low.tolist()], "high": [plain(x) for x in high.tolist()]}
        for column, (low, high) in ends.items()
        if low.any() or high.any()
    }


def plain(value: object, digits: int = 6) -> object:
    """Return a cell as JSON holds it: None for a missing one, floats to a number of significant digits."""
    cell = plain_cell(value)
    if not isinstance(cell, float):
        return cell
    return int(cell) if cell.is_integer() and abs(cell) < 2**53 else float(f"{cell:.{digits}g}")


def _counts(frame: pandas.DataFrame) -> dict[str, int]:
    """Return the number of trials with each status; rows without a trial number count as one each."""
    if "status" not in frame.columns:
        return {"finished": int(frame["trial"].nunique()) if "trial" in frame.columns else len(frame)}
    status = frame["status"].fillna("finished").astype(str)
    counted = frame["trial"].groupby(status).nunique() if "trial" in frame.columns else status.value_counts()
    order = sorted(counted.index, key=lambda name: (name == "failed", name))
    return {str(key): int(counted[key]) for key in order}


def _state(
    points: pandas.DataFrame, failed: Array, objectives: Mapping[str, str], present: Mapping[str, str]
) -> dict[str, str] | None:
    """Return the text in place of a figure without points, else None."""
    if not len(points) and failed.any():
        return {
            "title": "Every trial failed",
            "text": "No design was measured. The most frequent reason is often the cause of all others.",
        }
    if not len(points):
        return {
            "title": "No design yet",
            "text": "This study has no finished trial; `dse run` trains its designs.",
        }
    if not present:
        return {
            "title": "Nothing to compare",
            "text": f"No row has a value of {', '.join(objectives) or 'any objective'}.",
        }
    return None


def _lacking(points: pandas.DataFrame, values: Array) -> Array:
    """Return which points lack a number that others of their family have on their chip, or that all lack."""
    known: Array = np.isfinite(values)
    groups = [name for name in ("family", "hardware") if name in points]
    if not groups or not known.any():
        return ~known
    runs = points.assign(known=known).groupby(groups, dropna=False)["known"].transform("any")
    lacking: Array = ~known & np.asarray(runs, bool)
    return lacking


def _remarks(
    points: pandas.DataFrame, objectives: Mapping[str, str], present: Mapping[str, str], n_kept: int
) -> list[str]:
    """Return warnings about the figure."""
    if not len(points):
        return []
    remarks = [
        f"Column {column} is missing from this study and is not used for the front."
        for column in objectives
        if column not in present
    ]
    for column in present:
        values = numbers(points, column)
        missing = int(_lacking(points, values).sum())
        if missing:
            remarks.append(
                f"{missing} of {len(points)} points have no value of {column} and are excluded from fronts "
                "with it."
            )
        if len(points) > 1 and missing < len(points) and np.nanmin(values) == np.nanmax(values):
            remarks.append(
                f"{column} is {short(float(np.nanmin(values)))} for all designs, so it does not distinguish "
                "them."
            )
    if n_leaky := int((~honest(points)).sum()):
        remarks.append(
            f"{n_leaky} of {len(points)} points are transductive and excluded from fronts: the classifier "
            "has seen the labels."
        )
    if len(points) == 1:
        remarks.append("There is one design point so far; it is the front.")
    if n_kept < len(points):
        remarks.append(
            f"{short(n_kept, 9)} of {short(len(points), 9)} points are shown: all of each front, a sample of "
            "the rest. Fronts, the pick and the nearest design are exact; how many are feasible is an "
            "estimate, and those after the pick or the nearest are the best shown."
        )
    return remarks
