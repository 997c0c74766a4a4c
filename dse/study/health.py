"""What is worth saying of the finished trainings of a study, and of their decision settings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from dse.config.space import DecisionGrid
from dse.engine.neurons.fixed_point import STATE_LIMIT
from dse.measure.numbers import Numbers
from dse.study.record import RunRecord

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


def failures(trials: pandas.DataFrame) -> list[str]:
    """Return a sentence if designs failed, of those that were trained; `trials` as in `faults`."""
    trained = trials[trials["status"] != "excluded"]
    reasons = trained["reason"][trained["status"] == "failed"]
    first = f"the first: {reasons.iloc[0]}" if len(reasons) else ""
    return [f"{len(reasons)} of {len(trained)} designs failed; {first}"] if first else []


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


PREFIX = "decision: "
"""Begins every sentence; those of an earlier session are replaced."""

_NAMED = 3


def remarks(grid: DecisionGrid, trials: Mapping[int, Sequence[RunRecord]]) -> list[str]:
    """Return a sentence on best settings at the border of the grid, and one on a phi beyond all counts.

    Args:
        grid: that was evaluated.
        trials: trial number -> records of its runs.
    """
    measured = {trial: list(_measured(records)) for trial, records in sorted(trials.items())}
    on_border = [trial for trial, runs in measured.items() if any(x.get("t_p_on_border") for x in runs)]
    least = int(grid.phi[0]) if len(grid.phi) else 0
    beyond = [
        trial for trial, runs in measured.items() if any(x["output_spikes_most"] <= least for x in runs)
    ]
    sentences = []
    if on_border:
        sentences.append(
            f"{PREFIX}the best setting of {_named(on_border)} lies on the border of the grid of phi and "
            "theta; a wider grid may hold a better one (phi: {up_to: outputs} ends where phi has no effect)"
        )
    if beyond and least:
        sentences.append(
            f"{PREFIX}phi must be below the most output spikes of a sample, but its smallest value, {least}, "
            f"is not in {_named(beyond)}: nothing is decided there before the end of the input"
        )
    return sentences


def _measured(records: Iterable[RunRecord]) -> Iterable[Mapping[str, float]]:
    """Yield the columns of each run, of a joint net those of each head, that has a decision grid."""
    for record in records:
        if record.numbers is not None:
            heads: Sequence[Numbers] = list(record.numbers.of_heads.values()) or [record.numbers]
            yield from (x.columns for x in heads if x.columns.get("output_spikes_most") is not None)


def _named(trials: Sequence[int]) -> str:
    more = f" and {len(trials) - _NAMED} more" if len(trials) > _NAMED else ""
    return f"trial{'s' if len(trials) > 1 else ''} {', '.join(map(str, trials[:_NAMED]))}{more}"
