"""Runs -> the two tables of a study: one row per trial, and one row per design point.

Several runs (repeats) of a design are one row: numbers are means over its repeats. `accuracy_se` is the
Wilson standard error of the one run where there is one, and the standard error of the mean over seeds
(sample standard deviation / sqrt(repeats)) where there are several. A trial one of whose runs failed is a
failed trial: leaving the bad seed out would flatter the design.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dse import store
from dse.config import Axis, SearchSpace
from dse.metrics.accuracy import seeds_se
from dse.records import Array

if TYPE_CHECKING:
    import pandas

Record = Mapping[str, Any]
_LAST = ("status", "reason")


def trials_table(space: SearchSpace, trials: Mapping[int, Sequence[Record]]) -> pandas.DataFrame:
    """Return one row per trial: its design, what its full read-out measured, status and reason.

    Args:
        space: what was explored.
        trials: trial number -> records of its runs.
    """
    import pandas

    rows = []
    for trial, records in sorted(trials.items()):
        row = _named(space, trial, records)
        failed = [r for r in records if r["status"] == "failed"]
        row["status"] = "failed" if failed else "finished"
        row["reason"] = "; ".join(_blamed(r, len(records)) for r in failed)
        if not failed:
            profiles = list(records[0]["hardware"])
            row |= {"hardware": profiles[0]} if profiles else {}
            row |= summary(records, profiles[0] if profiles else None)
        rows.append(row)
    # Ordered by the longest row: a table that starts with a failed trial has its columns like any other.
    named = dict.fromkeys(key for row in sorted(rows, key=len, reverse=True) for key in row)
    frame = pandas.DataFrame(rows, columns=[*(n for n in named if n not in _LAST), *_LAST])
    claims = [n for n in named if any(isinstance(row.get(n), bool) for row in rows)]
    return frame.astype(dict.fromkeys(claims, "boolean"))


def points_table(
    space: SearchSpace, folder: Path, trials: Mapping[int, Sequence[Record]]
) -> pandas.DataFrame:
    """Return one row per trial x phi x theta x hardware profile of the finished trials.

    The first row of each is the full read-out, which answers at the end of the window: its phi and theta
    are NaN, and nothing is undecided. Without a decision grid there are only full read-outs, and no columns
    phi and theta.
    """
    import pandas

    parts = []
    for trial, records in sorted(trials.items()):
        if any(r["status"] == "failed" for r in records):
            continue
        surfaces = [_surface(folder, r) for r in records]
        for profile in records[0]["hardware"] or [None]:
            named = {"hardware": profile} if profile else {}
            full = summary(records, profile)
            grid = _grid([_of_profile(surface, profile) for surface in surfaces]) if surfaces[0] else {}
            always = {**_named(space, trial, records), **named, **full}
            if grid:
                end = {"phi": np.nan, "theta": np.nan, "accuracy_strict": full["accuracy"], "undecided": 0.0}
                grid = {n: np.concatenate([[(always | end).get(n, np.nan)], x]) for n, x in grid.items()}
            length = len(next(iter(grid.values()))) if grid else 1
            columns = {**always, **grid}
            parts.append(pandas.DataFrame({name: _column(value, length) for name, value in columns.items()}))
    return pandas.concat(parts, ignore_index=True) if parts else pandas.DataFrame()


def _named(space: SearchSpace, trial: int, records: Sequence[Record]) -> dict[str, Any]:
    """Return the columns that say what a row is about."""
    design = records[0]["design"]
    cells = {name: _cell(axis, design[name]) for name, axis in space.axes.items()}
    return {"trial": trial, "task": task_name(space, design), **cells, "repeats": len(records)}


def task_name(space: SearchSpace, design: Mapping[str, Any]) -> str:
    """Return what a design predicts: the task's name, or the columns of its target where that is an axis."""
    if "task.target" not in space.axes:
        return str(space.fixed["task"]["name"])
    target = design["task.target"]
    parts = target if isinstance(target, list | tuple) else [target]
    return "|".join(part["column"] if isinstance(part, Mapping) else str(part) for part in parts)


def _surface(folder: Path, record: Record) -> dict[str, Array]:
    """Return the arrays of a run's surface.npz, none where the run has no decision grid."""
    if "surface.npz" not in record["files"]:
        return {}
    return store.load_arrays(store.run_folder(folder, record["trial"], record["repeat"]) / "surface.npz")


def _cell(axis: Axis, value: Any) -> Any:
    """Return a plain value as it is, and JSON text on an axis that mixes kinds or holds lists or mappings."""
    values = axis.values or ()
    kinds = {
        bool if isinstance(v, bool) else float if isinstance(v, int | float) else type(v) for v in values
    }
    is_plain = len(kinds) <= 1 and not kinds & {tuple, list, dict}
    return value if is_plain else json.dumps(_short(value))


def _short(value: Any) -> Any:
    """Return a value whose whole floats are integers, as people write them: [1, 2.5], not [1.0, 2.5]."""
    if isinstance(value, list | tuple):
        return [_short(inner) for inner in value]
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _blamed(record: Record, n_runs: int) -> str:
    return f"repeat {record['repeat']}: {record['reason']}" if n_runs > 1 else str(record["reason"])


def summary(records: Sequence[Record], profile: str | None) -> dict[str, Any]:
    """Return a trial's full read-out: mean of every number, `all` of every claim, the accuracy's error.

    Args:
        records: finished runs of one trial.
        profile: hardware profile, or None for the columns that need none.
    """
    rows = [r["columns"] | (r["hardware"][profile] if profile else {}) for r in records]
    found: dict[str, Any] = {}
    for name, first in rows[0].items():
        values = [row[name] for row in rows]
        found[name] = all(values) if isinstance(first, bool) else _mean(values)
    if len(rows) > 1:
        found["accuracy_se"] = float(seeds_se([row["accuracy"] for row in rows]))
    return found


def _mean(values: Sequence[Any]) -> Any:
    if any(v is None for v in values):
        return np.nan
    return values[0] if all(v == values[0] for v in values) else float(np.mean(values))


def _of_profile(surface: Mapping[str, Array], profile: str | None) -> dict[str, Array]:
    """Return a surface's columns for one hardware profile."""
    own = {
        name.removeprefix(f"{profile}/"): x for name, x in surface.items() if name.startswith(f"{profile}/")
    }
    return {name: x for name, x in surface.items() if "/" not in name} | own


def _grid(surfaces: Sequence[Mapping[str, Array]]) -> dict[str, Array]:
    """Return the columns of a grid over phi and theta, theta fastest, summarised over repeats."""
    phi, theta = surfaces[0]["phi"], surfaces[0]["theta"]
    columns = {"phi": np.repeat(phi, len(theta)), "theta": np.tile(theta, len(phi))}
    for name in surfaces[0]:
        if name in columns:
            continue
        stacked = np.stack([surface[name] for surface in surfaces])
        if stacked.dtype == bool:
            columns[name] = stacked.all(axis=0).ravel()
        else:  # whole numbers that agree stay whole
            columns[name] = (stacked[0] if (stacked == stacked[0]).all() else stacked.mean(axis=0)).ravel()
    if len(surfaces) > 1:
        accuracy = np.stack([surface["accuracy"] for surface in surfaces])
        columns["accuracy_se"] = seeds_se(accuracy).ravel()
    return columns


def _column(value: Any, length: int) -> Any:
    return value if isinstance(value, np.ndarray) else [value] * length
