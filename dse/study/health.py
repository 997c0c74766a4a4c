"""What went wrong in trainings that finished: one sentence per kind of fault over all designs of a study."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from dse.neurons.fixed_point import STATE_LIMIT

if TYPE_CHECKING:
    import pandas

# Columns that are above 0 where the fault is there, what such designs do, and what to change.
_FAULTS = (
    (
        ("collapsed_outputs",),
        "give one answer to nearly every validation sample",
        "lower training.learning_rate or model.hidden_spike_penalty, or change model.loss or target rates",
    ),
    (
        ("saturated_neurons", "saturated_outputs"),
        "have neurons that fire in nearly every step",
        "lower model.initial_rate or training.learning_rate",
    ),
    (
        ("missed_initial_rates",),
        "began with a layer at less than half or more than twice its target spike rate",
        "compare initial_rate_hidden with model.initial_rate and initial_rate_output with the target rates; "
        "change these or the neuron's threshold, or give the model more input spikes",
    ),
    (
        ("collinear_dropout",),
        "silence hidden neurons whose counts rise and fall together",
        "set training.dropout to 0, and model.whitened to output (effective_rank says in how many directions "
        "counts differ)",
    ),
)


def faults(trials: pandas.DataFrame) -> list[str]:
    """Return one sentence per kind of fault: how many designs have it, in which columns, what to change.

    Args:
        trials: of `dse.study.results.Study.trials`.
    """
    finished = trials[trials["status"] == "finished"]
    sentences = []
    n = len(finished)
    if "input_spike_rate_hz" in finished:
        blind = finished["input_spike_rate_hz"] == 0
        if blind.any():  # all other faults follow from it
            sentences.append(
                f"{blind.sum()} of {n} designs get no input spikes (input_spike_rate_hz 0, first in trial "
                f"{int(finished['trial'][blind].iloc[0])}): lower the threshold of the encoder or of "
                "preprocessing"
            )
        finished = finished[~blind]
    if "overflows_24_bit" in finished:
        over = finished[finished["overflows_24_bit"].astype("boolean").fillna(False).to_numpy(bool)]
        if len(over):
            worst = max((row for _, row in over.iterrows()), key=lambda row: _number(row, "peak_state"))
            sentences.append(
                f"{len(over)} of {n} designs leave 24 bits (overflows_24_bit, first in trial "
                f"{int(over['trial'].iloc[0])}): {overflow(worst)}; lower training.learning_rate or "
                "model.initial_rate"
            )
    for columns, what, remedy in _FAULTS:
        shown = [name for name in columns if name in finished]
        faulty = finished[(finished[shown] > 0).any(axis=1)] if shown else finished.iloc[:0]
        if len(faulty):
            where = " or ".join(name for name in shown if (faulty[name] > 0).any())
            sentences.append(
                f"{len(faulty)} of {n} designs {what} ({where} > 0, first in trial "
                f"{int(faulty['trial'].iloc[0])}): {remedy}"
            )
    return sentences


def overflow(row: Mapping[str, Any] | pandas.Series[Any]) -> str:
    """Return by how much the states of a design leave 24 bits, and what follows; '' where they do not.

    Args:
        row: columns of a trial, or of a design point.
    """
    if not _number(row, "overflows_24_bit"):
        return ""
    times, thresholds = _number(row, "peak_state") / STATE_LIMIT, _number(row, "peak_thresholds")
    most = f"{times:.3g} times what 24 bits hold"
    if thresholds:
        most = f"{thresholds:.0f} thresholds, and 24 bits hold {thresholds / times:.0f}"
    return (
        f"the largest state is {most}: a chip of such states, as Loihi, answers otherwise (`fits` is false); "
        "C holds states whole"
    )


def _number(row: Mapping[str, Any] | pandas.Series[Any], name: str) -> float:
    """Return a number of a row; 0 where it has none."""
    import pandas

    value = row.get(name)
    return 0.0 if value is None or pandas.isna(value) else float(value)
