"""What is worth saying about the decision settings of a study, one sentence each."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from dse.config.space import DecisionGrid
from dse.study.record import Numbers, RunRecord

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
