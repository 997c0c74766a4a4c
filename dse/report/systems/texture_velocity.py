"""D, E: networks for texture and for velocity profile: ends of the front, and correlates of accuracy."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from dse.measure.correlation import spearman
from dse.report.designs import StudyTask, best
from dse.report.marks import Mark, mark
from dse.report.papers import publication, systems
from dse.report.rows import Row, measured, number
from dse.skyline.front import front_ends

if TYPE_CHECKING:
    import pandas

# The printed S leaves the input out and is a sum over the test set; its mean on validation selects designs.
_FIGURES = {"accuracy": "accuracy", "spikes": "spikes_total_no_input", "n_weights": "n_weights"}
_CHOICE = "spikes_per_inference_no_input"
# What the figures of the published table are called here.
_TITLES = {
    "accuracy": "accuracy",
    "spikes": "spikes_total_no_input (printed S)",
    "n_weights": "n_weights",
}
_PAPER = "002"
_TASKS = {"D": "texture", "E": "movement"}
_PEAK = ("hidden", "true_rate")


def rows(parts: Sequence[StudyTask]) -> list[Row]:
    """Return the ends of the front, rank correlations, and accuracy by kind of profile."""
    table: list[Row] = []
    for part in parts:
        system = "E" if part.of_movement else "D"
        for family in systems()[system].families:
            designs = part.of([family])
            if not designs.empty:
                table += _of_family(part, system, designs, _kind(part, family))
    return table


def marks(parts: Sequence[StudyTask]) -> Iterator[Mark]:
    """Yield the ends of the published front; spikes as printed, which fit a sum over the test set."""
    for part in parts:
        system = "E" if part.of_movement else "D"
        if best(part.of(systems()[system].families)) is None:
            continue
        for end in publication(_PAPER).table("accuracy", _TASKS[system]):
            values = {column: _printed(system, figure, end) for figure, column in _FIGURES.items()}
            of_peak = " and ".join(f"{name} {_printed(system, name):g}" for name in _PEAK)
            spikes = "spikes are those of hidden and output neurons over the test set"
            more = f"{of_peak}; {spikes}" if end == "best accuracy" else spikes
            yield mark(system, part, end, values, more)


def _printed(system: str, figure: str, *conditions: str) -> float:
    return publication(_PAPER).number(figure, _TASKS[system], *conditions)


def _kind(part: StudyTask, family: str) -> str:
    """Return the prefix of rows of cascades and of joint networks; '' for networks of one task."""
    return f"{family}: " if family == "cascade" else "joint net: " if part.joint else ""


def _of_family(part: StudyTask, system: str, designs: pandas.DataFrame, kind: str) -> Iterator[Row]:
    peak = best(designs)
    if peak is None:
        return
    ends = front_ends(designs, spikes=_CHOICE).rows
    for index, end in zip(ends.index, ends["end"], strict=True):
        chosen = peak if end == "best accuracy" else designs.loc[index]
        for figure, column in _FIGURES.items():
            printed = _printed(system, figure, end)
            yield measured(part, system, f"{kind}{end}: {_TITLES[figure]}", printed, chosen, column)
        figure = f"{kind}{end}: {_CHOICE}"
        yield measured(part, system, figure, None, chosen, _CHOICE)
    yield from _peak(part, system, peak, kind)
    for figure, printed in publication(_PAPER).table("spearman", _TASKS[system]).items():
        cost = _CHOICE if figure == "spikes" else _FIGURES[figure]
        rho = spearman(designs["accuracy"].to_numpy(float), designs[cost].to_numpy(float))
        text = f"{kind}Spearman of accuracy and {figure}, {len(designs)} designs"
        yield Row(system, text, part.task, printed, number(rho), split=part.split, study=part.name)
    if system == "E":
        yield from _groups(part, peak, publication(_PAPER).table("groups", _TASKS[system]), kind)


def _peak(part: StudyTask, system: str, peak: pandas.Series[Any], kind: str) -> Iterator[Row]:
    """Yield the printed settings of the most accurate network beside ours."""
    model = part.model(int(peak["trial"]))
    for name in _PEAK:
        if hasattr(model, name):
            printed = _printed(system, name)
            base = measured(part, system, f"{kind}best accuracy: {name}", printed, peak)
            yield replace(base, ours=number(np.sum(getattr(model, name))), se=None, test=None)


def _groups(
    part: StudyTask, peak: pandas.Series[Any], printed: Mapping[str, float], kind: str
) -> Iterator[Row]:
    """Yield the best network's accuracy on each kind of profile, where classes are named after them."""
    classes = part.classes(int(peak["trial"]))
    runs = part.arrays(int(peak["trial"]), "confusion")
    for group, figure in printed.items():
        members = [k for k, name in enumerate(classes) if name.startswith(group)]
        shares = [_right(run["validation"], members) for run in runs]
        tests = [_right(run["test"], members) for run in runs if "test" in run]
        if members and None not in shares:
            base = measured(part, "E", f"{kind}best accuracy: {group} profiles", figure, peak)
            test = float(np.mean(tests)) if tests and None not in tests else None  # type: ignore[arg-type]
            yield replace(base, ours=float(np.mean(shares)), se=None, test=test)  # type: ignore[arg-type]


def _right(matrix: np.ndarray, members: list[int]) -> float | None:
    """Return the share of samples of some classes that are answered right; None without samples."""
    total = matrix[members].sum()
    return float(matrix[members, members].sum() / total) if total else None
