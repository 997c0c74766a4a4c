"""Fronts of a study, and the files of what the networks on them measured at other precisions.

A setting is (weight_bits, pruned): it states how the weights of a trained network are rounded
(`dse.models.snn.quantise`). The results at a setting are one file of the study,

    precision/<trial>-<repeat>/<weight_bits>_<pruned>.npz

an archive like that of the run (`dse.store.runs`): the record, with `weight_bits` and `pruned`, and the
arrays of what was measured. A setting is finished if its file exists.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dse import store
from dse.base.records import Array
from dse.engine.neurons.fixed_point import BITS
from dse.study.record import RunRecord

if TYPE_CHECKING:
    import pandas

Setting = tuple[int, float]
RunFile = tuple[Path, RunRecord]
"""The archive of a run, or of an evaluation of it, and the record in it."""

FOLDER = "precision"
"""Of a study."""

AS_TRAINED: Setting = (BITS, 0.0)

_ROUNDING = 1e-9  # accuracies are ratios of counts: closer than this they are equal


def refusal(folder: Path) -> str:
    """Return why a run has no other precisions, in words; '' if it has."""
    arrays = store.load_arrays(folder / "weights.npz", ("arithmetic",))
    if "arithmetic" not in arrays:
        return "is not a single stack of spiking layers"
    arithmetic = str(arrays["arithmetic"])
    return "" if arithmetic == "integer" else f"runs in {arithmetic} arithmetic"


def missing(run: Path, settings: Sequence[Setting]) -> tuple[Setting, ...]:
    """Return the settings that a run was not evaluated at, including those with a damaged file."""
    return tuple(setting for setting in settings if read(file_of(run, setting)) is None)


def evaluations(run: Path) -> dict[Setting, RunFile]:
    """Return what a run answers at other precisions, by bits, then pruned; damaged files are skipped."""
    return dict(sorted(filter(None, map(read, files_of(run)))))


def common(runs: Sequence[Path]) -> dict[Setting, list[RunFile]]:
    """Return the settings at which all of some runs were evaluated, with the evaluation of each run."""
    each = [evaluations(run) for run in runs]
    return {setting: [of[setting] for of in each] for setting in each[0] if all(setting in of for of in each)}


def as_trained(points: pandas.DataFrame) -> pandas.DataFrame:
    """Return the design points at the trained precision."""
    if "weight_bits" not in points:
        return points
    return points[~((points["weight_bits"] < BITS) | (points["pruned_after"] > 0))]


def near(
    points: pandas.DataFrame, front: pandas.DataFrame, objectives: Sequence[tuple[str, str]], within: float
) -> set[int]:
    """Return the trials on a front, and those with a point close below it in accuracy.

    The front's accuracy at a point is the best among its rows that are no worse in every other objective. It
    is the first objective that is an accuracy, such as accuracy_shifted.

    Args:
        points: the design points behind the front.
        front: its rows.
        objectives: (column, 'max' or 'min') pairs; without accuracy, only the front itself.
        within: largest difference in accuracy.
    """
    trials: set[int] = set(front["trial"].tolist())
    accuracies = (
        name for name, direction in objectives if name.startswith("accuracy") and direction == "max"
    )
    quality = next(accuracies, None)
    if quality is None:
        return trials
    costs = [(name, 1.0 if direction == "min" else -1.0) for name, direction in objectives if name != quality]

    def others(rows: pandas.DataFrame) -> Array:
        columns = [sign * rows[name].to_numpy(np.float64, na_value=np.nan) for name, sign in costs]
        return np.stack(columns, axis=1) if columns else np.zeros((len(rows), 0))

    best_first = front.sort_values(quality, ascending=False, kind="stable")
    cost, accuracy = others(points), points[quality].to_numpy(np.float64)
    left = np.flatnonzero(np.isfinite(cost).all(axis=1) & np.isfinite(accuracy))
    for top, limits in zip(best_first[quality].tolist(), others(best_first), strict=True):
        reached = (limits <= cost[left]).all(axis=1)
        close = top - accuracy[left[reached]] <= within + _ROUNDING
        trials |= set(points["trial"].to_numpy()[left[reached][close]].tolist())
        left = left[~reached]
    return trials


def save(run: Path, setting: Setting, record: RunRecord, parts: Mapping[str, Mapping[str, Array]]) -> None:
    """Write what a run measured at a setting: its record with these numbers, and the arrays of its parts."""
    weight_bits, pruned = setting
    about = {"study": run.parents[1].absolute().name, "weight_bits": weight_bits, "pruned": pruned}
    store.save_run(file_of(run, setting), {**record.to_plain(), **about}, parts, replaces=True)


def file_of(run: Path, setting: Setting) -> Path:
    """Return the file of the results of a run at a setting."""
    return _folder(run) / _name(setting)


def files_of(run: Path) -> list[Path]:
    """Return the files of all evaluations of a run."""
    return sorted(_folder(run).glob("*.npz"))


def _name(setting: Setting) -> str:
    return f"{setting[0]}_{float(setting[1])!r}.npz"


def _folder(run: Path) -> Path:
    return run.parents[1] / FOLDER / run.stem


def read(path: Path) -> tuple[Setting, RunFile] | None:
    """Return the setting of a file and what was answered there; None if it is missing or damaged."""
    try:
        plain = store.load_run(path)
        if plain is None or path.name != _name(setting := (plain["weight_bits"], plain["pruned"])):
            return None
        return setting, (path, RunRecord.from_plain(plain, path))
    except (store.StoreError, LookupError, ValueError, TypeError):
        return None


GROUPS = ("task", "family", "hardware")
"""Columns whose values have a front each: costs compare on one chip alone, and every family has its front."""


def as_if_larger(points: pandas.DataFrame) -> pandas.DataFrame:
    """Return points with hardware that holds none of them replaced by a larger one of its kind.

    A search that finds nothing that fits goes on towards the best designs: at fewer bits, or pruned, they may
    fit. What no hardware can run stays left out.
    """
    from dse.skyline.admissible import fitting

    if not {"fits", "hardware"} <= set(points):
        return points
    held = points["hardware"].isin(points["hardware"][fitting(points)])
    return points.assign(fits=points["fits"].mask(~held & points["fits"].notna(), True))


def fronts(
    points: pandas.DataFrame, goals: Sequence[tuple[str, str]]
) -> Iterator[tuple[pandas.DataFrame, pandas.DataFrame]]:
    """Yield the points of every task, family and chip as they were trained, and the front of these.

    Hardware that holds no point counts as larger (`as_if_larger`). Other precisions are left out: if they
    changed which designs are trained again, the result would depend on interruptions.
    """
    from dse.skyline.front import skyline

    table = as_trained(as_if_larger(points))
    if table.empty:
        return
    by = [name for name in GROUPS if name in table.columns]
    for _, group in table.groupby(by, observed=True) if by else [((), table)]:
        yield group, skyline(group, goals).rows
