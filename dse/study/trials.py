"""Runs -> a study's table of one row per trial.

Several runs (repeats) of a design are one row: numbers are means over its repeats. `accuracy_se` is the
Wilson standard error for one run, and the standard error of the mean over seeds (sample standard deviation /
sqrt(repeats)) for several. Reaction times on the test set also have their least and largest value over the
repeats. A trial with a failed run is a failed trial: leaving that seed out would flatter the design.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dse.base import registry
from dse.config import Axis, SearchSpace
from dse.measure.numbers import Numbers
from dse.measure.objectives import flat
from dse.measure.objectives.accuracy import seeds_se
from dse.measure.objectives.accuracy_unseen import as_arrays, merged, unseen_columns
from dse.study.ledger import Entry
from dse.study.record import STOPPED, RunRecord

if TYPE_CHECKING:
    import pandas

    from dse.base.records import Array

_LAST = ("status", "reason")

_WITH_ERRORS = ("accuracy", "accuracy_shifted", "accuracy_shifted_min")  # over seeds, by the runs
# What one run has, the trial has.
_WORST = ("peak_state", "peak_thresholds", "overflows_24_bit")


def trials_table(
    space: SearchSpace, trials: Mapping[int, Sequence[RunRecord]], excluded: Sequence[Entry] = ()
) -> pandas.DataFrame:
    """Return one row per trial: its design, the numbers of its full read-out, status and reason.

    Excluded designs were not trained; their status is 'excluded', with the reason.
    """
    import pandas

    rows = []
    for trial, records in sorted(trials.items()):
        row = named(space, trial, records[0].design, len(records))
        failed = [record for record in records if record.failed]
        stopped = [record for record in records if record.stopped_at_epoch is not None]
        row["status"] = "failed" if failed else STOPPED if stopped else "finished"
        row["reason"] = "; ".join(_blamed(r, len(records)) for r in failed)
        if stopped and not failed:
            row["reason"] = stopped[0].reason
            row["stopped_at_epoch"] = stopped[0].stopped_at_epoch
            row["accuracy_when_stopped"] = summary([x.last for x in stopped], None)["accuracy"]
        elif not failed:
            numbers = [record.measured for record in records]
            profile = next(iter(numbers[0].hardware), None)
            row |= {} if profile is None else {"hardware": profile}
            row |= summary(numbers, profile)
        rows.append(row)
    for entry in excluded:
        about = named(space, entry.trial, entry.design, 0)
        rows.append(about | {"status": "excluded", "reason": entry.excluded})
    rows.sort(key=lambda row: row["trial"])
    # Ordered by the longest row: a table that starts with a failed trial has its columns like any other.
    names = dict.fromkeys(key for row in sorted(rows, key=len, reverse=True) for key in row)
    frame = pandas.DataFrame(rows, columns=[*(n for n in names if n not in _LAST), *_LAST])
    if "stopped_at_epoch" in frame:
        frame = frame.astype({"stopped_at_epoch": "Int64"})
    claims = [n for n in names if any(isinstance(row.get(n), bool) for row in rows)]
    return frame.astype(dict.fromkeys(claims, "boolean"))


def named(space: SearchSpace, trial: int, design: Mapping[str, Any], repeats: int) -> dict[str, Any]:
    """Return the columns that identify a row; an axis that the design does not have is missing."""
    cells = {
        name: axis.cell(design[name]) if name in design else _missing(axis)
        for name, axis in space.axes.items()
    }
    about = {"trial": trial, "task": space.task_name(design), "family": space.kind("model", design)}
    return {**about, **cells, "repeats": repeats}


def _missing(axis: Axis) -> float | None:
    """Return the cell without a value: NaN on an axis of numbers, None on any other."""
    values = axis.values or ()
    return np.nan if all(isinstance(v, int | float) and not isinstance(v, bool) for v in values) else None


def _blamed(record: RunRecord, n_runs: int) -> str:
    return f"repeat {record.repeat}: {record.reason}" if n_runs > 1 else record.reason


def summary(runs: Sequence[Numbers], profile: str | None) -> dict[str, Any]:
    """Return a trial's full read-out: mean of every number, `all` of every claim, errors of accuracies.

    A fold that training leaves out counts once, whatever the number of runs that trained it. Of states that
    leave their registers the worst run counts.

    Args:
        runs: measurements of the runs of one trial.
        profile: hardware profile, or None for the columns without hardware.
    """
    rows = [{**run.columns, **(run.hardware[profile] if profile else {})} for run in runs]
    names = dict.fromkeys(name for row in rows for name in row)
    known = [{name: np.nan if row.get(name) is None else row[name] for name in names} for row in rows]
    columns = flat(over_runs([{name: np.asarray(x) for name, x in row.items()} for row in known]))
    unseen = flat(unseen_columns(merged([as_arrays(run.unseen) for run in runs])))
    return {name: x for name, x in columns.items() if name not in unseen} | unseen


def over_runs(runs: Sequence[Mapping[str, Array]]) -> dict[str, Array]:
    """Return the columns that all of some runs have, over the runs: (...) each, as in a run.

    Mean of every number, and `all` of every claim; of states that leave their registers the worst run counts.
    Several runs also have errors of accuracies, and least and largest values (`Column.ranged`).
    """
    columns: dict[str, Array] = {}
    shared = [name for name in runs[0] if all(name in run for run in runs)]
    of_runs = {name: np.stack([run[name] for run in runs]) for name in shared}
    for name, x in of_runs.items():
        if name in _WORST:
            columns[name] = np.asarray(x.max(axis=0))
        elif x.dtype == bool:
            columns[name] = np.asarray(x.all(axis=0))
        else:  # whole numbers that agree stay whole
            columns[name] = np.asarray(x[0] if (x == x[0]).all() else x.mean(axis=0))
    if len(runs) > 1:
        columns |= {f"{name}_se": seeds_se(of_runs[name]) for name in _WITH_ERRORS if name in of_runs}
        for name in [name for name, column in registry.columns().items() if column.ranged]:
            if name in of_runs:
                columns[f"{name}_min"] = np.asarray(of_runs[name].min(axis=0))
                columns[f"{name}_max"] = np.asarray(of_runs[name].max(axis=0))
    return columns
