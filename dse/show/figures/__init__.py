"""Figures of a study: each file gathers a record of plain numbers, then draws the record with plotly.

To add one, here or in a module of your own, write a file with

    @register("figures", "accuracy_by_size")
    @dataclass(frozen=True)
    class AccuracyBySize:                                   its fields are the keys of `dse figure --set`
        def gather(self, results: Results) -> Record        pure: a dataclass of plain numbers
        def draw(self, record: Record) -> Figure            adds no number of its own

`dse.testing.check_figure` says what it lacks; `dse figure RESULTS accuracy_by_size --out FILE` draws it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol, TypeVar

import numpy as np
import pandas

from dse.base import registry
from dse.base.records import Array, Dataset
from dse.base.registry import fixed
from dse.config.faults import known_names
from dse.config.values import Report, read_object, refuse
from dse.data.preprocessing.stages import Stages
from dse.measure.hardware.profile import Profile
from dse.show.figures.labels import Drawing
from dse.skyline.table import Goal

R = TypeVar("R")


class Results(Protocol):
    """What a figure may read of a study; `dse.study.results.Study` is one."""

    @property
    def trials(self) -> pandas.DataFrame:
        """One row per trial."""

    @property
    def objectives(self) -> Sequence[tuple[str, str]]:
        """(column, 'max' or 'min') of each objective of the search space."""

    def points(self) -> pandas.DataFrame:
        """Return one row per design point."""

    def best_trial(self) -> int:
        """Return the most accurate finished trial."""

    def classes(self, trial: int) -> tuple[str, ...]:
        """Return the names of the classes of a trial."""

    def sections(self, trial: int) -> Mapping[str, Any]:
        """Return the sections of a trial's design as plain data, such as 'encoder' with its kind and keys."""

    def arrays(self, trial: int, name: str) -> list[dict[str, Array]]:
        """Return what a file of a trial's artefacts holds, such as read_out.npz, for each of its runs."""

    def stages(self, trial: int, sample: int) -> Stages:
        """Return an event recording at every stage of a trial's preprocessing; it is read again."""

    def dataset(self, trial: int) -> Dataset:
        """Return what a trial was trained on."""

    def chip(self, name: str) -> Profile:
        """Return a hardware profile as the study keeps it, or a shipped one."""


class NothingRecorded(ValueError):
    """A study did not record what a figure shows; one sentence."""


class Figure(Protocol[R]):
    """A figure of a study; its fields are its keys.

    What it cannot show is a `ValueError` of one sentence: `NothingRecorded` where a study has no such thing.
    """

    def gather(self, results: Results) -> R:
        """Return what is drawn: a dataclass of numbers, arrays and texts, or a tuple of them."""

    def draw(self, record: R) -> Drawing:
        """Return the record as a plotly figure."""


def trial_key() -> Any:
    """Declare the key `trial` of a figure (`trial_of`)."""
    return fixed(None, doc="number of the trial (default: the most accurate one that has what is drawn)")


def task_key() -> Any:
    """Declare the key `task` of a figure (`of_task`)."""
    return fixed("", doc="what is predicted (default: the first task)")


def hardware_key() -> Any:
    """Declare the key `hardware` of a figure (`on_one_chip`)."""
    return fixed("", doc="hardware profile of the costs (default: the first of the study)")


def named(name: str, keys: Mapping[str, Any], report: Report = refuse) -> Figure[Any] | None:
    """Return a figure with its keys, as they are written or as Python has them; None after a fault.

    Args:
        name: of the figure.
        keys: of its component.
        report: called with (path, sentence) for every mistake; absent: a `ValueError` is raised.
    """
    figures = registry.known("figures")
    if name not in figures:
        where = registry.elsewhere("figures", name)
        report((), f"unknown figure '{name}'{where}; {known_names(name, figures)}")
        return None
    return read_object(figures[name], dict(keys), (name,), report)


def draw(results: Results, name: str, **keys: Any) -> Drawing:
    """Return a figure of a study, with the keys of its component.

    Raises:
        ValueError: no such figure or key, or it has nothing to show.
    """
    figure = named(name, keys)
    assert figure is not None  # else it was refused
    return figure.draw(figure.gather(results))


def on_one_chip(points: pandas.DataFrame, hardware: str = "") -> pandas.DataFrame:
    """Return the points on one hardware profile; without a name the first, without hardware all."""
    return _of_first(points, "hardware", hardware) if "hardware" in points and len(points) else points


def chip_of(results: Results, hardware: str = "") -> Profile:
    """Return a hardware profile; without a name the first of the study."""
    if not hardware:
        points = results.points()
        if "hardware" not in points or points.empty:
            raise ValueError("hardware must name a profile: the study has none")
        hardware = str(points["hardware"].iloc[0])
    return results.chip(hardware)


def with_value(points: pandas.DataFrame, column: str, value: str) -> pandas.DataFrame:
    """Return the points with a value in a column; all of them where the value is ''."""
    if not value:
        return points
    values = list(dict.fromkeys(map(str, points[column]))) if column in points else []
    if value not in values:
        raise ValueError(f"{column} must be one of {', '.join(values)}, got '{value}'")
    return points[points[column].astype(str) == value]


def of_task(rows: pandas.DataFrame, task: str = "") -> pandas.DataFrame:
    """Return the rows of one task; without a name those of the first.

    Raises:
        ValueError: no row is of it.
    """
    return _of_first(rows, "task", task)


def _of_first(rows: pandas.DataFrame, column: str, value: str) -> pandas.DataFrame:
    """Return the rows with a value in a column; without a value those with the first one."""
    first = str(rows[column].iloc[0]) if column in rows and len(rows) else ""
    return with_value(rows, column, value or first)


def full_read_outs(points: pandas.DataFrame) -> pandas.DataFrame:
    """Return the points that answer at the end of the window, as trained."""
    frame = points
    for name in ("phi", "read_out_ms"):
        if name in frame:
            frame = frame[frame[name].isna()]
    return frame.drop_duplicates(["trial", *(name for name in ("task", "hardware") if name in frame)])


def gain_of(results: Results, points: pandas.DataFrame) -> tuple[str | None, list[Goal]]:
    """Return the column that is maximised, and the other objectives, as far as points have them."""
    goals = [Goal(name, way) for name, way in results.objectives if name in points]
    gain = next((goal.column for goal in goals if goal.direction == "max"), None)
    return gain, [goal for goal in goals if goal.column != gain]


def trial_of(results: Results, trial: int | None) -> int:
    """Return a trial, or the most accurate one where none is given."""
    return results.best_trial() if trial is None else trial


def recorded(
    results: Results, trial: int | None, name: str, array: str = ""
) -> tuple[int, list[dict[str, Array]]]:
    """Return a trial, and the arrays of a file of every run of it.

    Args:
        results: of a study.
        trial: its number; None: the most accurate trial that has the file and the array.
        name: of the file.
        array: what the file must hold beside.

    Raises:
        NothingRecorded: no run has the file with the array.
    """
    for each in map(int, ranked(results)["trial"]) if trial is None else [trial]:
        runs = results.arrays(each, name)
        if runs and (not array or array in runs[0]):
            return each, runs
    who, what = "no trial" if trial is None else f"trial {trial}", f"'{array}' in {name}" if array else name
    raise NothingRecorded(f"{who} recorded {'' if trial is None else 'no '}{what}")


def ranked(results: Results) -> pandas.DataFrame:
    """Return the rows of the finished trials, the most accurate first."""
    trials = results.trials
    finished = trials[trials["status"] == "finished"]
    return finished.sort_values("accuracy", ascending=False, kind="stable")


def mean_of(runs: Sequence[Mapping[str, Array]], name: str) -> Array:
    """Return the mean of an array over runs."""
    return np.asarray(np.mean([run[name] for run in runs], axis=0))
