"""D, E: networks for texture and for velocity profile: ends of the front, and correlates of accuracy."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from dse.measure.correlation import spearman
from dse.registry import param
from dse.report.designs import StudyTask, best
from dse.report.marks import Mark, mark
from dse.report.papers import Paper, paper
from dse.report.rows import Row, measured, number
from dse.skyline.front import front_ends

if TYPE_CHECKING:
    import pandas

_FIGURES = {"accuracy": "accuracy", "spikes": "spikes_total", "n_weights": "n_weights"}
# What the figures of the published table are called here.
_TITLES = {
    "accuracy": "accuracy",
    "spikes": "spikes_total (printed S)",
    "n_weights": "n_weights",
}


@dataclass(frozen=True)
class End:
    """An end of the published front; spikes S as printed."""

    accuracy: float = param(doc="accuracy")
    spikes: float = param(doc="S as printed, which fits a sum over the test set")
    n_weights: float = param(doc="W_t")


@dataclass(frozen=True)
class Front(Paper):
    """The published front.

    ends, spearman: by name of the end, and by figure the rank correlation with accuracy.
    peak: settings of the most accurate network.
    groups: accuracy by kind of profile.
    """

    ends: Mapping[str, End] = param(doc="ends of the front")
    spearman: Mapping[str, float] = param(doc="rank correlation with accuracy, by figure")
    peak: Mapping[str, Any] = param(doc="settings of the most accurate network")
    groups: Mapping[str, float] = field(default_factory=dict)


def _front(system: str) -> Front:
    return paper(system, Front)


def rows(parts: Sequence[StudyTask]) -> list[Row]:
    """Return the ends of the front, rank correlations, and accuracy by kind of profile."""
    table: list[Row] = []
    for part in parts:
        system = "E" if part.of_movement else "D"
        for family in _front(system).families:
            designs = part.of([family])
            if not designs.empty:
                table += _of_family(part, system, designs, _kind(part, family))
    return table


def marks(parts: Sequence[StudyTask]) -> Iterator[Mark]:
    """Yield the ends of the published front; spikes as printed, which fit a sum over the test set."""
    for part in parts:
        system = "E" if part.of_movement else "D"
        front = _front(system)
        if best(part.of(front.families)) is None:
            continue
        for end, printed in front.ends.items():
            values = {column: getattr(printed, figure) for figure, column in _FIGURES.items()}
            of_peak = " and ".join(f"{name} {x}" for name, x in front.peak.items())
            spikes = "spikes fit a sum over the test set"
            more = f"{of_peak}; {spikes}" if end == "best accuracy" else spikes
            yield mark(system, part, end, values, more)


def _kind(part: StudyTask, family: str) -> str:
    """Return the prefix of rows of cascades and of joint networks; '' for networks of one task."""
    return f"{family}: " if family == "cascade" else "joint net: " if part.joint else ""


def _of_family(part: StudyTask, system: str, designs: pandas.DataFrame, kind: str) -> Iterator[Row]:
    front = _front(system)
    peak = best(designs)
    if peak is None:
        return
    ends = front_ends(designs, spikes="spikes_total").rows
    for index, end in zip(ends.index, ends["end"], strict=True):
        chosen = peak if end == "best accuracy" else designs.loc[index]
        for figure, column in _FIGURES.items():
            printed = getattr(front.ends[end], figure)
            yield measured(part, system, f"{kind}{end}: {_TITLES[figure]}", printed, chosen, column)
        figure = f"{kind}{end}: spikes_per_inference (Eq. 3)"
        yield measured(part, system, figure, None, chosen, "spikes_per_inference")
    yield from _peak(part, system, peak, kind)
    for figure, printed in front.spearman.items():
        pair = designs[["accuracy", _FIGURES[figure]]].astype(float)
        rho = spearman(pair["accuracy"].to_numpy(), pair[_FIGURES[figure]].to_numpy())
        text = f"{kind}Spearman of accuracy and {figure}, {len(pair)} designs"
        yield Row(system, text, part.task, printed, number(rho), split=part.split, study=part.name)
    if system == "E":
        yield from _groups(part, peak, front.groups, kind)


def _peak(part: StudyTask, system: str, peak: pandas.Series[Any], kind: str) -> Iterator[Row]:
    """Yield the printed settings of the most accurate network beside ours."""
    model = part.model(int(peak["trial"]))
    for name, printed in _front(system).peak.items():
        if hasattr(model, name):
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
