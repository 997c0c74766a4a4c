"""Reaction times of a run: how soon it is at its best, at the human baseline, and near its peak.

Source: Brayshaw et al., real-time texture classification, Eqs. (5) and (6); temporal and spatio-temporal
domains, t_C (REFERENCES.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from dse.measure import decision
from dse.measure.objectives import FullReadOut
from dse.registry import Column, register


@register("objectives", "reaction_times")
@dataclass(frozen=True)
class ReactionTimes:
    """t_P and t_H over the settings of the decision maker, t_C over input lengths."""

    needs = "full_read_out"
    columns = (
        Column(
            "t_p_ms",
            "ms",
            "min",
            "Shortest mean decision time among the settings (phi, theta) of best accuracy.",
            of_design=True,
        ),
        Column(
            "t_h_ms",
            "ms",
            "min",
            "Shortest mean decision time among the settings that reach human accuracy.",
            of_design=True,
        ),
        Column(
            "t_c_ms",
            "ms",
            "min",
            "Shortest input length at which accuracy is within 10 % of its peak.",
            of_design=True,
        ),
    )

    def measure(self, answer: FullReadOut) -> Mapping[str, float | None]:
        times: dict[str, float | None] = {}
        if answer.read_outs is not None:
            times["t_c_ms"] = decision.t_c(answer.read_outs.decision_latency_ms, answer.read_outs.accuracy)
        if answer.decisions is not None:
            times["t_p_ms"] = decision.t_p(answer.decisions).decision_latency_ms
            at_human = decision.t_h(answer.decisions)
            times["t_h_ms"] = None if at_human is None else at_human.decision_latency_ms
        return times
