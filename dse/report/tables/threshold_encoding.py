"""Threshold encoding: accuracy as printed, which reads the label, and without; first output spikes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from dse.report.designs import StudyTask, best
from dse.report.ours import NO_HONEST, VALIDATION, Measure, Ours, Side, missing, of_column

if TYPE_CHECKING:
    import pandas

_ACCURACY = {"accuracy_test": "", "accuracy": VALIDATION}
_HONEST = "means of the training set; the printed encoding reads the label"
_ENDS = {"fastest": "min", "slowest": "max"}


def labels(part: StudyTask) -> dict[str, str]:
    """Return no conditions."""
    return {}


def _row(side: Side) -> tuple[pandas.Series[Any] | None, bool]:
    """Return the best design with the printed encoding, else the best one; and whether it is as printed."""
    leaky = best(side.designs(transductive=True))
    return (best(side.designs()), False) if leaky is None else (leaky, True)


def _accuracy(side: Side, condition: Mapping[str, str]) -> Ours:
    row, as_printed = _row(side)
    ours = of_column(side, row, _ACCURACY)
    return ours if as_printed or ours.value is None else replace(ours, same=False, why=_because(ours.why))


def _first_spike(side: Side, condition: Mapping[str, str]) -> Ours:
    row, as_printed = _row(side)
    if row is None:
        return missing("no such design")
    end = next(column for name, column in _ENDS.items() if condition["texture"].startswith(name))
    columns = {
        f"first_spike_test_class_{end}_ms": "",
        f"first_spike_class_{end}_ms": VALIDATION,
        "first_spike_ms": f"mean over all textures, {VALIDATION}",
    }
    ours = of_column(side, row, columns)
    return ours if as_printed or ours.value is None else replace(ours, same=False, why=_because(ours.why))


def _because(why: str) -> str:
    return "; ".join(filter(None, [_HONEST, why]))


def _without_leak(side: Side, condition: Mapping[str, str]) -> Ours:
    row = best(side.designs())
    return missing(NO_HONEST) if row is None else replace(of_column(side, row, _ACCURACY), why=_HONEST)


def _median_first_spike(side: Side, condition: Mapping[str, str]) -> Ours:
    columns = {"first_spike_test_class_median_ms": "", "first_spike_class_median_ms": VALIDATION}
    return of_column(side, _row(side)[0], columns)


OURS: Mapping[str, Measure] = {"accuracy": _accuracy, "first_spike_ms": _first_spike}
UNPRINTED: Mapping[str, Measure] = {
    "accuracy without the leak": _without_leak,
    "inference time, median over the textures, ms": _median_first_spike,
}
