"""Power of a chip at rest, and while it computes (`dse.hardware.cost`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from dse.measure.objectives import Priced
from dse.records import Array
from dse.registry import Column, register


@register("objectives", "power")
@dataclass(frozen=True)
class Power:
    """Power at rest and while an inference is computed, with their intervals; none of counted operations."""

    needs = "hardware"
    columns = (
        Column("power_idle_w", "W", "min", "Power at rest; NaN where nobody has published it."),
        Column("power_idle_w_low", "W", "min", "The same with every number at its low end."),
        Column("power_idle_w_high", "W", "min", "The same with every number at its high end."),
        Column("power_w", "W", "min", "Mean power while an inference is computed at full speed."),
        Column("power_w_low", "W", "min", "Least power within the ranges of the profile's numbers."),
        Column("power_w_high", "W", "min", "Largest power within the ranges of the profile's numbers."),
    )

    def measure(self, priced: Priced) -> Mapping[str, Array | float]:
        cost = priced.cost
        if not cost.timed:
            return {}
        return {**cost.power_idle_w.columns("power_idle_w"), **cost.power_w.columns("power_w")}
