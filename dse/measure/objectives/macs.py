"""Multiply-accumulates: what classifiers on real numbers do in place of a spike's additions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from dse.measure.objectives import Points
from dse.records import Floats
from dse.registry import Column, register


@register("objectives", "macs")
@dataclass(frozen=True)
class Macs:
    """Multiply-accumulates per inference."""

    needs = "points"
    columns = (
        Column(
            "macs",
            "",
            "min",
            "Mean multiply-accumulates per inference; a spiking network only adds, so it has none.",
        ),
    )

    def measure(self, points: Points) -> Mapping[str, Floats]:
        return {"macs": points.load.macs}
