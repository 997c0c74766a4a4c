"""Fronts of a study, and the files of what the networks on them measured at other precisions.

A setting is (weight_bits, pruned): it states how the weights of a trained network are rounded
(`dse.models.snn.quantise`). The results at a setting are one file of the study,

    precision/<trial>-<repeat>/<weight_bits>_<pruned>.npz
        schema, trial, repeat, weight_bits, pruned
        numbers          JSON text: the measured part of record.json
        <file>/<name>    the arrays of <file> at this setting, such as read_out.npz

which is written atomically: a setting is finished if its file exists.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dse import store
from dse.neurons.fixed_point import BITS
from dse.records import Array
from dse.study.record import Numbers

if TYPE_CHECKING:
    import pandas

Setting = tuple[int, float]

FOLDER = "precision"
"""Of a study."""

AS_TRAINED: Setting = (BITS, 0.0)

_SCHEMA = "dse/precision/1"
_KEYS = ("schema", "trial", "repeat", "weight_bits", "pruned", "numbers")
_ROUNDING = 1e-9  # accuracies are ratios of counts: closer than this they are equal


@dataclass(frozen=True)
class Evaluation:
    """The measurement of a run at one setting.

    files: name of a file, such as read_out.npz -> its arrays.
    """

    weight_bits: int
    pruned: float
    numbers: Numbers
    files: Mapping[str, Mapping[str, Array]]

    @property
    def setting(self) -> Setting:
        return self.weight_bits, self.pruned


def refusal(folder: Path) -> str:
    """Return why a run has no other precisions, in words; '' if it has."""
    arrays = store.load_arrays(folder / "weights.npz", ("arithmetic",))
    if "arithmetic" not in arrays:
        return "is not a single stack of spiking layers"
    arithmetic = str(arrays["arithmetic"])
    return "" if arithmetic == "integer" else f"runs in {arithmetic} arithmetic"


def missing(folder: Path, settings: Sequence[Setting]) -> tuple[Setting, ...]:
    """Return the settings that a run was not evaluated at, including those with a damaged file."""
    return tuple(setting for setting in settings if _read(file_of(folder, setting)) is None)


def is_damaged(path: Path) -> bool:
    """Return whether the file of an evaluation is damaged, or of another schema or run."""
    return _read(path) is None


def rows(folder: Path) -> list[Evaluation]:
    """Return the evaluations of a run, by bits and then by pruned fraction; damaged files are skipped."""
    evaluations = (_read(path) for path in files_of(folder))
    return sorted((x for x in evaluations if x is not None), key=lambda x: x.setting)


def common(folders: Sequence[Path]) -> list[tuple[Setting, list[Evaluation]]]:
    """Return the settings at which all of some runs were evaluated, with the evaluation of each run."""
    of_runs = [{x.setting: x for x in rows(folder)} for folder in folders]
    shared = [setting for setting in of_runs[0] if all(setting in of_run for of_run in of_runs)]
    return [(setting, [of_run[setting] for of_run in of_runs]) for setting in shared]


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


def save(run: Path, setting: Setting, numbers: Numbers, files: Mapping[str, Mapping[str, Array]]) -> None:
    """Write the results of a run at a setting.

    Args:
        run: its file.
        setting: at which it was measured.
        numbers: measured there.
        files: name of a file -> its arrays.
    """
    named = store.named(run)
    assert named is not None  # it is the file of a run
    arrays = {
        "schema": np.array(_SCHEMA),
        "trial": np.array(named[0]),
        "repeat": np.array(named[1]),
        "weight_bits": np.array(setting[0]),
        "pruned": np.array(setting[1]),
        "numbers": np.array(json.dumps(numbers.to_plain(), default=store.plain)),
        **{f"{file}/{name}": x for file, of_file in files.items() for name, x in of_file.items()},
    }
    with store.published(file_of(run, setting)) as temporary:
        store.save_arrays(temporary, arrays)


def file_of(run: Path, setting: Setting) -> Path:
    """Return the file of the results of a run at a setting."""
    weight_bits, pruned = setting
    return _folder(run) / f"{weight_bits}_{float(pruned)!r}.npz"


def files_of(run: Path) -> list[Path]:
    """Return the files of all evaluations of a run."""
    return sorted(_folder(run).glob("*.npz"))


def _folder(run: Path) -> Path:
    return run.parents[1] / FOLDER / run.stem


def _read(path: Path) -> Evaluation | None:
    """Return the evaluation in a file; None if it is missing, damaged, or of another schema or run."""
    try:
        arrays = store.load_arrays(path)
        if str(arrays["schema"]) != _SCHEMA:
            return None
        numbers = Numbers.from_plain(json.loads(str(arrays["numbers"])))
        setting = int(arrays["weight_bits"]), float(arrays["pruned"])
        run = store.run_file(path.parents[2], int(arrays["trial"]), int(arrays["repeat"]))
        if path != file_of(run, setting):
            return None
    except (store.Damaged, KeyError, ValueError, TypeError, AttributeError):
        return None
    files: dict[str, dict[str, Array]] = {}
    for key, array in arrays.items():
        if key not in _KEYS:
            file, name = key.split("/", 1)
            files.setdefault(file, {})[name] = array
    return Evaluation(*setting, numbers, files)


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
