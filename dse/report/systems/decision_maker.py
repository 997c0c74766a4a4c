"""A: peak accuracy and decision times over the length of a sample, trained per length and read out early.

Shown for textures and objects; networks for movements and joint ones are under D and E.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from dse.hardware.interval import column_names
from dse.measure.objectives.accuracy import seeds_se
from dse.report.designs import StudyTask, best
from dse.report.marks import Mark, mark
from dse.report.papers import publication, systems
from dse.report.rows import Row, measured, number
from dse.store import StoreError

if TYPE_CHECKING:
    import pandas

_TIMES = {"t_p_ms": ("phi_p", "theta_p"), "t_h_ms": ("phi_h", "theta_h")}

_PAPER = "000"
_PLATFORM = "Loihi 2"


def _lengths_ms() -> np.ndarray:
    """Return the printed sample lengths."""
    return np.array([int(length) for length in publication(_PAPER).table("accuracy")])


def _printed(figure: str, at: int) -> float:
    """Return the figure of the printed length at a place."""
    return publication(_PAPER).number(figure, str(_lengths_ms()[at]))


def rows(parts: Sequence[StudyTask]) -> list[Row]:
    """Return accuracy, t_p and t_h with their settings: nets of each trained length, and early read-outs."""
    table: list[Row] = []
    for part, designs in _shown(parts):
        for chosen, length, at in _by_length(designs):
            table += _of_length(part, chosen, length, at)
        lengths = designs["decision_latency_ms"]
        longest = best(designs[lengths == lengths.max()])
        if longest is not None:
            shorter = sorted(lengths.unique())[:-1]
            table += _early(part, longest, shorter)
            table += _hardware(part, longest)
    return table


def marks(parts: Sequence[StudyTask]) -> Iterator[Mark]:
    """Yield the published networks of the lengths that match ours, at their peak accuracy."""
    for part, designs in _shown(parts):
        for chosen, _, at in _by_length(designs):
            values = {"accuracy": _printed("accuracy", at)}
            if "t_p_ms" in chosen.index:  # the mean time of a decision at these settings is t_p
                values |= {"decision_latency_ms": _printed("t_p_ms", at), "phi": _printed("phi_p", at)}
                values |= {"theta": _printed("theta_p", at)}
                values |= {name: _printed(name, at) for name in _TIMES}
            if number(chosen.get("n_cores")) is not None:
                values["n_cores"] = publication(_PAPER).number("n_cores", _PLATFORM)
            yield mark("A", part, f"samples of {_lengths_ms()[at]} ms", values)


def _shown(parts: Sequence[StudyTask]) -> Iterator[tuple[StudyTask, pandas.DataFrame]]:
    """Yield the tasks that are compared with this system, and their designs; D and E show the others."""
    for part in parts:
        designs = part.of(systems()["A"].families)
        if not (designs.empty or part.of_movement or part.joint):
            yield part, designs


def _by_length(designs: pandas.DataFrame) -> Iterator[tuple[pandas.Series[Any], float, int]]:
    """Yield the best design of each trained length, that length, and the place of the printed one.

    It stands beside the printed length that is as much of the longest.
    """
    lengths, printed_ms = designs["decision_latency_ms"], _lengths_ms()
    several = lengths.nunique() > 1
    for length in sorted(lengths.unique()):
        chosen = best(designs[lengths == length])
        if chosen is not None:
            beside_ms = length / lengths.max() * printed_ms[-1] if several else length
            yield chosen, length, int(np.abs(printed_ms - beside_ms).argmin())


def printed() -> Iterator[Row]:
    """Return the power of the paper's platforms."""
    printed = publication(_PAPER)
    for platform in printed.table("power_w"):
        numbers = "; ".join(f"{power:g}" for power in printed.table("power_w", platform).values())
        yield Row("A", f"power of {platform}, W: idle; beyond; in all", published=numbers)


def _of_length(part: StudyTask, chosen: pandas.Series[Any], length: float, at: int) -> Iterator[Row]:
    """Yield the figures of one trained length beside those of one printed length."""
    where = f"{length:g} ms (printed: {_lengths_ms()[at]} ms)"
    yield measured(part, "A", f"accuracy, {where}", _printed("accuracy", at), chosen)
    last = _last(part, chosen)
    if "accuracy_best" in last:
        peak = measured(
            part, "A", f"peak over phi and theta, {length:g} ms", _printed("accuracy", at), chosen
        )
        none = dict.fromkeys(("se", "test", *column_names("corrected")))
        yield replace(peak, ours=last["accuracy_best"], **none)
    for time, settings in _TIMES.items():
        row = measured(part, "A", f"{time}, {where}", _printed(time, at), chosen, time)
        if row.ours is None and time not in chosen.index:
            continue  # no decision grid
        yield row
        for name in settings:
            yield replace(
                row,
                figure=f"{name}, {length:g} ms",
                published=_printed(name, at),
                ours=last.get(name),
                test=None,
            )


def _last(part: StudyTask, chosen: pandas.Series[Any]) -> Mapping[str, float | None]:
    """Return peak accuracy and the settings behind the times of the full read-out, mean over the runs."""
    runs = part.arrays(int(chosen["trial"]), "read_out")
    figures = ["accuracy_best", *(name for settings in _TIMES.values() for name in settings)]
    names = [name for name in figures if name in runs[0]]
    return {name: number(np.mean([run[name][-1] for run in runs])) for name in names}


def _early(part: StudyTask, row: pandas.Series[Any], lengths: Sequence[float]) -> Iterator[Row]:
    """Yield the accuracy of one network that is read out after shorter lengths than it was trained on."""
    if not lengths:
        return
    runs = part.arrays(int(row["trial"]), "read_out")
    times = runs[0]["decision_latency_ms"]
    if any(len(run["decision_latency_ms"]) != len(times) for run in runs):
        raise StoreError(f"{part.study.folder}: trial {row['trial']}: its runs have different read-outs")
    for k in dict.fromkeys(int(np.abs(times - length).argmin()) for length in lengths):
        for column in ("accuracy", *_TIMES):
            if column not in runs[0]:
                continue
            each = np.array([run[column][k] for run in runs])
            test = [run["accuracy_test"][k] for run in runs if "accuracy_test" in run]
            figure = f"{column}, longest net read out at {times[k]:g} ms"
            error = seeds_se(each) if len(each) > 1 else runs[0]["accuracy_se"][k]
            yield replace(
                measured(part, "A", figure, None, row, column),
                ours=number(each.mean()),
                se=number(error) if column == "accuracy" else None,
                test=number(np.mean(test)) if test and column == "accuracy" else None,
            )


def _hardware(part: StudyTask, row: pandas.Series[Any]) -> Iterator[Row]:
    printed = publication(_PAPER)
    if number(row.get("n_cores")) is not None:
        figure = f"n_cores, {row['hardware']} (printed: of {printed.number('cores_of_chip'):g})"
        yield measured(part, "A", figure, printed.number("n_cores", _PLATFORM), row, "n_cores")
    if "energy_uj" in row.index:
        yield measured(part, "A", f"energy_uj per inference, {row['hardware']}", None, row, "energy_uj")
