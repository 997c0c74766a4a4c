"""Receptors and ELM: accuracy with the printed split, which leaks, and without; recognition over time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from dse.report.designs import StudyTask, best
from dse.report.ours import VALIDATION, Measure, Ours, Side, missing, of_column, over_runs

if TYPE_CHECKING:
    import pandas

_ACCURACY = {"accuracy_test": "", "accuracy": VALIDATION}
_HONEST = "no window of the test overlaps one of the training set, as those of the paper do"
_RATE = "input_spike_rate_hz"
_WITHIN = 0.9


def labels(part: StudyTask) -> dict[str, str]:
    """Return no conditions."""
    return {}


def _row(side: Side) -> tuple[pandas.Series[Any] | None, bool]:
    """Return the best design with the printed split, else the best one; and whether it is as printed."""
    leaky = best(side.designs(transductive=True))
    return (best(side.designs()), False) if leaky is None else (leaky, True)


def _accuracy(side: Side, condition: Mapping[str, str]) -> Ours:
    row, as_printed = _row(side)
    ours = of_column(side, row, _ACCURACY)
    return (
        ours
        if as_printed or ours.value is None
        else replace(ours, same=False, why="; ".join(filter(None, [_HONEST, ours.why])))
    )


def _recognition(side: Side, condition: Mapping[str, str]) -> Ours:
    """Return the input length with the highest accuracy, of each run."""
    row, _ = _row(side)
    if row is None:
        return missing("no such design")
    runs = side.part.arrays(int(row["trial"]), "read_out")
    column = "accuracy_test" if all("accuracy_test" in run for run in runs) else "accuracy"
    times = [float(run["decision_latency_ms"][int(run[column].argmax())]) for run in runs]
    on_test = column == "accuracy_test"
    return replace(over_runs(times, row), same=on_test, why="" if on_test else VALIDATION)


def _spike_rate(side: Side, condition: Mapping[str, str]) -> Ours:
    row, _ = _row(side)
    return of_column(side, row, {_RATE: ""})


def _least_rate(side: Side, condition: Mapping[str, str]) -> Ours:
    """Return the lowest spike rate whose best accuracy is within a tenth of the highest."""
    designs = side.part.table[side.part.table["family"].isin(side.families)]
    if _RATE not in designs or designs[_RATE].isna().all():
        return missing(f"the study did not record {_RATE}")
    accuracy = designs["accuracy"].astype(float)
    near = designs[accuracy >= _WITHIN * accuracy.max()]
    rates = near[_RATE].astype(float)
    lowest = np.nanmin(designs[_RATE].astype(float))
    why = f"lowest rate within 10 % of the best accuracy; rates of the study begin at {lowest:.3g} Hz"
    place = int(np.nanargmin(rates))
    return replace(over_runs([float(rates.iloc[place])], near.iloc[place]), same=False, why=why)


def _without_leak(side: Side, condition: Mapping[str, str]) -> Ours:
    return replace(of_column(side, best(side.designs()), _ACCURACY), why=_HONEST)


def _information(side: Side, condition: Mapping[str, str]) -> Ours:
    row, _ = _row(side)
    return of_column(side, row, {"itr_bits": "", "itr_bits_test": ""})


OURS: Mapping[str, Measure] = {
    "accuracy": _accuracy,
    "recognition_ms": _recognition,
    "spike_rate_hz": _spike_rate,
    "least_rate_hz": _least_rate,
}
UNPRINTED: Mapping[str, Measure] = {
    "accuracy without the leak": _without_leak,
    "information transfer (Fig. 12 draws it), bit": _information,
}
