"""How sure the decision maker is: samples that never reach theta, ties, and what they cost in accuracy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from dse.measure.objectives import Points
from dse.records import Floats
from dse.registry import Column, register


@register("objectives", "decisions")
@dataclass(frozen=True)
class Decisions:
    """Undecided samples and ties of every setting (phi, theta)."""

    needs = "points"
    columns = (
        Column("accuracy_strict", "", "max", "Accuracy where undecided samples count as wrong."),
        Column("undecided", "", "min", "Fraction of samples that never reach the confidence theta."),
        Column("ties", "", "min", "Fraction of samples that are decided between classes of equal spikes."),
    )

    def measure(self, points: Points) -> Mapping[str, Floats]:
        if points.decisions is None:
            return {}
        return {column.name: getattr(points.decisions, column.name) for column in self.columns}
