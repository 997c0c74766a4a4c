"""Threshold encoding: accuracy as printed, which reads the label, and without; first output spikes."""

from __future__ import annotations

from collections.abc import Mapping

from dse_papers.report.ours import (
    ACCURACY,
    VALIDATION,
    Measure,
    Ours,
    Side,
    missing,
    of_column,
    unless_printed,
    without_leak,
)

_HONEST = "means of the training set; the printed encoding reads the label"
_ENDS = {"fastest": "min", "slowest": "max"}


def _accuracy(side: Side, condition: Mapping[str, str]) -> Ours:
    row, as_printed = side.as_printed
    return unless_printed(of_column(side, row, ACCURACY), as_printed, _HONEST)


def _first_spike(side: Side, condition: Mapping[str, str]) -> Ours:
    row, as_printed = side.as_printed
    if row is None:
        return missing("no such design")
    end = next(column for name, column in _ENDS.items() if condition["texture"].startswith(name))
    columns = {
        f"first_spike_test_class_{end}_ms": "",
        f"first_spike_class_{end}_ms": VALIDATION,
        "first_spike_ms": f"mean over all textures, {VALIDATION}",
    }
    return unless_printed(of_column(side, row, columns), as_printed, _HONEST)


def _median_first_spike(side: Side, condition: Mapping[str, str]) -> Ours:
    columns = {"first_spike_test_class_median_ms": "", "first_spike_class_median_ms": VALIDATION}
    return of_column(side, side.as_printed[0], columns)


OURS: Mapping[str, Measure] = {"accuracy": _accuracy, "first_spike_ms": _first_spike}
UNPRINTED: Mapping[str, Measure] = {
    "accuracy without the leak": without_leak(_HONEST),
    "inference time, median over the textures, ms": _median_first_spike,
}
