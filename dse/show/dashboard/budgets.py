"""The data for exact budgets on a page: the columns that they limit, and the rows that can be picked."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
import pandas

from dse.base.records import Array, Ints
from dse.show.figures.front import numbers
from dse.skyline.admissible import honest
from dse.skyline.constraints import ExpressionError, split_budgets
from dse.skyline.pareto import members_of, non_dominated
from dse.skyline.pick import economy, ties
from dse.skyline.table import group_numbers

# In addition to the objectives: the first column of each group with numbers in the table.
_BESIDE = (("latency_ms", "decision_latency_ms", "hardware_latency_ms"), ("spikes_per_inference",))
_FILTERS = ("task", "family", "hardware")


def budget_columns(points: pandas.DataFrame, objectives: Mapping[str, str]) -> dict[str, str]:
    """Return the columns with a budget and their directions: objectives, latency, spikes.

    A column that `dse pick --budget` cannot name has no budget.
    """
    beside = [
        next((name for name in names if np.isfinite(numbers(points, name)).any()), None)
        for names in _BESIDE
        if not any(name in objectives for name in names)
    ]
    directions = {**objectives, **{name: "min" for name in beside if name}}
    return {name: way for name, way in directions.items() if _can_be_named(name)}


def gather_budgets(
    points: pandas.DataFrame,
    objectives: Mapping[str, str],
    results: str,
    hardware: Sequence[str],
    others: Collection[str],
) -> dict[str, Any]:
    """Gather the data for a page's budgets, as plain values that JSON can hold.

    Returns:
        columns: {column: 'max' or 'min'} of each column with a budget;
        maximise: the column that `dse pick` maximises, None if no column can be maximised;
        ties: [column, 'max' or 'min'], what decides between equally good points, in this order;
        results, hardware: folder of the study and profiles, for the commands that the page shows;
        ranges: values of the filters, and {column: [least, largest]} of the points with these values, also of
        others, which may have a budget on a page in another state.
    """
    columns = budget_columns(points, objectives)
    upwards = [*(name for name, way in objectives.items() if way == "max"), "accuracy"]
    maximise = next((name for name in upwards if np.isfinite(numbers(points, name)).any()), None)
    return {
        "columns": columns,
        "maximise": maximise,
        "ties": [list(goal) for goal in ties(points, maximise or "", list(objectives.items()))],
        "results": results,
        "hardware": list(hardware),
        "ranges": _ranges(points, list(dict.fromkeys([*objectives, *columns, *others]))),
    }


def contenders(points: pandas.DataFrame, objectives: Mapping[str, str], maximise: str | None) -> Array:
    """Return the row numbers that decide a front, a pick or the nearest row under any budgets and filters.

    A row cannot be picked if another row of the same task, family and hardware beats it in the objectives and
    is at least as good in what decides between equals and in every column with a budget: any budget that
    admits the first admits the second.
    Rows with the same objectives as a returned row are returned too, since equal rows share a front.
    """
    deciding = {goal.column: goal.direction for goal in economy(points)}
    gain = [maximise, f"{maximise}_corrected"] if maximise else []  # as `ties` has it
    limited = {
        **deciding,
        **budget_columns(points, objectives),
        **{name: "max" for name in gain if name in points},
    }
    limited = {**objectives, **limited}
    if not objectives or not len(points):
        return np.zeros(0, np.int64)
    signed = [(-1.0 if way == "max" else 1.0) * numbers(points, name) for name, way in limited.items()]
    costs = np.column_stack([np.where(np.isfinite(values), values, np.inf) for values in signed])
    among = []
    for group in _groups(points, (*_FILTERS, "fits", "transductive")):
        best = group[non_dominated(costs[group])]
        alike = _alike(costs[group, : len(objectives)])
        among.append(group[np.isin(alike, alike[np.searchsorted(group, best)])])
    return np.sort(np.concatenate(among))


def _groups(points: pandas.DataFrame, columns: Sequence[str]) -> list[Ints]:
    """Return the row numbers of each combination of values."""
    return members_of(group_numbers(points, [name for name in columns if name in points]))


def _can_be_named(column: str) -> bool:
    try:
        budgets, _ = split_budgets([f"{column} <= 0"])
    except ExpressionError:
        return False
    return [budget.column for budget in budgets] == [column]


def _alike(costs: Array) -> Array:
    """Return a number for each row; rows with equal costs have equal numbers."""
    frame = pandas.DataFrame(costs)
    return np.asarray(frame.groupby(list(frame.columns), sort=False, dropna=False).ngroup())


def _ranges(points: pandas.DataFrame, columns: Sequence[str]) -> list[dict[str, Any]]:
    """Return the range of each column, for each combination of the filters' values."""
    keep = honest(points)
    values = {name: numbers(points, name) for name in columns}
    ranges = []
    for group in _groups(points, _FILTERS):
        rows = group[keep[group]]
        finite = {name: x[rows][np.isfinite(x[rows])] for name, x in values.items()}
        ranges.append(
            {name: str(points[name].iloc[group[0]]) for name in _FILTERS if name in points.columns}
            | {"ends": {name: [float(x.min()), float(x.max())] for name, x in finite.items() if len(x)}}
        )
    return ranges
