"""Time of the decision, as the sensor sees it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from dse.measure.objectives import Points
from dse.records import Floats
from dse.registry import Column, register


@register("objectives", "decision_latency_ms")
@dataclass(frozen=True)
class DecisionLatency:
    """Time from the first touch to the decision, without the time that hardware adds (`latency_ms`)."""

    needs = "points"
    columns = (
        Column(
            "decision_latency_ms",
            "ms",
            "min",
            "Mean time from the first touch to the decision, by the clock of the sensor.",
            known="bound",
        ),
    )

    def measure(self, points: Points) -> Mapping[str, Floats]:
        return {"decision_latency_ms": points.decision_latency_ms}
