"""Receptors and ELM: accuracy with the printed split, which leaks, and without; recognition over time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from dse.show.report.designs import sections_of
from dse_papers.report.ours import (
    ACCURACY,
    SPREAD,
    VALIDATION,
    Measure,
    Ours,
    Side,
    missing,
    of_column,
    over_runs,
    unless_printed,
    without_leak,
)

if TYPE_CHECKING:
    import pandas

_HONEST = "windows of test and training do not overlap; the printed ones do"
_RATE = "input_spike_rate_hz"
_WITHIN = 0.9


def _accuracy(side: Side, condition: Mapping[str, str]) -> Ours:
    row, as_printed = side.as_printed
    return unless_printed(of_column(side, row, ACCURACY), as_printed, _HONEST)


def _recognition(side: Side, condition: Mapping[str, str]) -> Ours:
    """Return the input length with the highest accuracy, of each run."""
    row, _ = side.as_printed
    if row is None:
        return missing("no such design")
    runs = side.part.arrays(int(row["trial"]), "read_out")
    column = "accuracy_test" if all("accuracy_test" in run for run in runs) else "accuracy"
    times = [float(run["decision_latency_ms"][int(run[column].argmax())]) for run in runs]
    on_test = column == "accuracy_test"
    return replace(over_runs(times, row), same=on_test, why="" if on_test else VALIDATION)


def _spike_rate(side: Side, condition: Mapping[str, str]) -> Ours:
    row, _ = side.as_printed
    ours = of_column(side, row, {_RATE: ""})
    if row is None or ours.value is None:
        return ours
    copies = _copies(side, row)
    spread: dict[str, Any] = {x: copies * y for x, y in vars(ours).items() if x in SPREAD and y is not None}
    return replace(ours, **spread)


def _copies(side: Side, row: pandas.Series[Any]) -> int:
    """Return the number of input channels that share the spikes of a receptor."""
    encoder = sections_of(side.part.study.folder, int(row["trial"])).encoder
    return int(getattr(encoder, "spikes_per_step", 1))


def _least_rate(side: Side, condition: Mapping[str, str]) -> Ours:
    """Return the lowest spike rate whose best accuracy is within a tenth of the highest."""
    designs = side.part.table[side.part.table["family"].isin(side.families)]
    designs = designs[designs[_RATE].notna()] if _RATE in designs else designs[:0]
    if designs.empty:
        return missing(f"the study did not record {_RATE}")
    accuracy = designs["accuracy"].astype(float)
    near = designs[accuracy >= _WITHIN * accuracy.max()]
    rates = [_copies(side, row) * float(row[_RATE]) for _, row in near.iterrows()]
    lowest = min(_copies(side, row) * float(row[_RATE]) for _, row in designs.iterrows())
    why = f"lowest rate within 10 % of the best accuracy; rates of the study begin at {lowest:.3g} Hz"
    place = int(np.argmin(rates))
    return replace(over_runs([rates[place]], near.iloc[place]), same=False, why=why)


def _information(side: Side, condition: Mapping[str, str]) -> Ours:
    row, _ = side.as_printed
    return of_column(side, row, {"itr_bits": "", "itr_bits_test": ""})


OURS: Mapping[str, Measure] = {
    "accuracy": _accuracy,
    "recognition_ms": _recognition,
    "spike_rate_hz": _spike_rate,
    "least_rate_hz": _least_rate,
}
UNPRINTED: Mapping[str, Measure] = {
    "accuracy without the leak": without_leak(_HONEST),
    "information transfer (Fig. 12 draws it), bit": _information,
}
