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
    """Return one row per design point of the finished trials, on every hardware profile.

    The first row of each trial and profile is the full read-out, which answers at the end of the window: its
    phi, theta and read_out_ms are NaN, and nothing is undecided. Rows with phi and theta answer when the
    decision maker does, rows with read_out_ms after so much of the input. A joint net has the rows of each of
    its heads, under the head's task, so that they meet nets of one task on one front.
    """
    import pandas

    parts: list[dict[str, Array]] = []
    for trial, records in sorted(trials.items()):
        if any(r["status"] == "failed" for r in records):
            continue
        for head in records[0].get("of_heads") or [None]:
            for profile in records[0]["hardware"] or [None]:
                rows = _points(folder, records, head, profile)
                n = len(rows["accuracy"])
                always = _named(space, trial, records)
                always |= ({"task": head} if head else {}) | ({"hardware": profile} if profile else {})
                parts.append({name: _repeated(value, n) for name, value in always.items()} | rows)
    names = dict.fromkeys(name for part in parts for name in part)
    frame = pandas.DataFrame(
        {
            name: np.concatenate([part.get(name, np.full(len(part["trial"]), np.nan)) for part in parts])
            for name in names
        }
    )
    claims = [name for name in frame if any(part[name].dtype == bool for part in parts if name in part)]
    # A chip that no design can run on has no energies; fronts of the study's objectives still look for them.
    lacking = {} if frame.empty else {name: np.nan for name, _ in space.objectives if name not in frame}
    return frame.astype(dict.fromkeys(claims, "boolean")).assign(**lacking)


# Columns of one answer, not of its design: rows that do not measure them have none.
_OF_ONE_ANSWER = ("itr_bits", "itr_bits_per_s", "accuracy_strict", "undecided", "phi", "theta", "read_out_ms")


# Of read-outs, the settings behind their decision times: a row per setting is on the surface.
_OF_SETTINGS = (
    *("phi_p", "theta_p", "phi_h", "theta_h"),
    *("accuracy_best", "accuracy_best_strict", "t_p_strict_ms", "t_h_strict_ms"),
)


def _points(
    folder: Path, records: Sequence[Record], head: str | None, profile: str | None
) -> dict[str, Array]:
    """Return the columns of a trial's rows: the full read-out, its surface, its earlier read-outs."""
    suffix = f"_{head}" if head else ""
    full = summary(records if head is None else [r["of_heads"][head] for r in records], profile)
    surfaces = _loaded(folder, records, f"surface{suffix}.npz")
    read_outs = _loaded(folder, records, f"read_out{suffix}.npz")
    end = {"phi": np.nan, "theta": np.nan, "accuracy_strict": full["accuracy"], "undecided": 0.0}
    first = full | (end if surfaces else {}) | ({"read_out_ms": np.nan} if read_outs else {})
    pieces = [{name: _repeated(value, 1) for name, value in first.items()}]
    if surfaces:
        pieces.append(_grid([_of_profile(x, profile) for x in surfaces]))
    if read_outs:
        pieces.append(_earlier([_of_profile(x, profile) for x in read_outs]))
    names = dict.fromkeys(name for piece in pieces for name in piece)
    columns: dict[str, list[Array]] = {name: [] for name in names}
    for piece in pieces:
        n = len(piece["accuracy"])
        for name, column in columns.items():
            own = np.nan if name in _OF_ONE_ANSWER else first.get(name, np.nan)
            column.append(piece[name] if name in piece else _repeated(own, n))
    return {name: np.concatenate(column) for name, column in columns.items()}


def _loaded(folder: Path, records: Sequence[Record], name: str) -> list[dict[str, Array]]:
    """Return a file of every run of a trial; none where the first run has no such file."""
    if name not in records[0]["files"]:
        return []
    return [
        store.load_arrays(store.run_folder(folder, record["trial"], record["repeat"]) / name)
        for record in records
    ]


def _named(space: SearchSpace, trial: int, records: Sequence[Record]) -> dict[str, Any]:
    """Return the columns that say what a row is about; an axis that the design does not have is missing."""
    design = records[0]["design"]
    cells = {
        name: _cell(axis, design[name]) if name in design else _missing(axis)
        for name, axis in space.axes.items()
    }
    about = {"trial": trial, "task": task_name(space, design), "family": family(space, design)}
    return {**about, **cells, "repeats": len(records)}


def family(space: SearchSpace, design: Mapping[str, Any]) -> str:
    """Return the kind of a design's model."""
    return str(design["model.kind"] if "model.kind" in space.axes else space.fixed["model"]["kind"])


def task_name(space: SearchSpace, design: Mapping[str, Any]) -> str:
    """Return what a design predicts: the task's name, or the columns of its target where that is an axis."""
    if "task.target" not in space.axes:
        return str(space.fixed["task"]["name"])
    target = design["task.target"]
    parts = target if isinstance(target, list | tuple) else [target]
    sign = "+" if space.fixed["task"].get("joint") else "|"
    return sign.join(part["column"] if isinstance(part, Mapping) else str(part) for part in parts)


def _cell(axis: Axis, value: Any) -> Any:
    """Return a plain value as it is, and JSON text on an axis that mixes kinds or holds lists or mappings."""
    values = axis.values or ()
    kinds = {
        bool if isinstance(v, bool) else float if isinstance(v, int | float) else type(v) for v in values
    }
    is_plain = len(kinds) <= 1 and not kinds & {tuple, list, dict}
    return value if is_plain else json.dumps(_short(value))


def _missing(axis: Axis) -> float | None:
    """Return what stands for no value: NaN on an axis of numbers, None on any other."""
    values = axis.values or ()
    return np.nan if all(isinstance(v, int | float) and not isinstance(v, bool) for v in values) else None


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
    for name in dict.fromkeys(name for row in rows for name in row):  # what one run lacks, no mean has
        values = [row.get(name) for row in rows]
        found[name] = all(values) if all(isinstance(v, bool) for v in values) else _mean(values)
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
    measured = _averaged([{k: x for k, x in s.items() if k not in ("phi", "theta")} for s in surfaces])
    return {"phi": np.repeat(phi, len(theta)), "theta": np.tile(theta, len(phi))} | measured


def _earlier(read_outs: Sequence[Mapping[str, Array]]) -> dict[str, Array]:
    """Return the columns of the read-outs before the end of the window, summarised over repeats."""
    found = _averaged([{name: x for name, x in one.items() if name not in _OF_SETTINGS} for one in read_outs])
    return {name: x[:-1] for name, x in ({"read_out_ms": found["decision_latency_ms"]} | found).items()}


def _averaged(runs: Sequence[Mapping[str, Array]]) -> dict[str, Array]:
    """Return the columns of several runs: mean of every number, `all` of every claim, accuracy's error."""
    columns = {}
    for name in runs[0]:
        stacked = np.stack([run[name] for run in runs])
        if stacked.dtype == bool:
            columns[name] = stacked.all(axis=0).ravel()
        else:  # whole numbers that agree stay whole
            columns[name] = (stacked[0] if (stacked == stacked[0]).all() else stacked.mean(axis=0)).ravel()
    if len(runs) > 1:
        columns["accuracy_se"] = seeds_se(np.stack([run["accuracy"] for run in runs])).ravel()
    return columns


def _repeated(value: Any, n: int) -> Array:
    """Return one value n times."""
    return np.full(n, value, dtype=object if value is None or isinstance(value, str) else None)
