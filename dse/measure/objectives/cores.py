"""Whether and where a network fits on a chip."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from dse.measure.objectives import Priced
from dse.registry import Column, register


@register("objectives", "cores")
@dataclass(frozen=True)
class Cores:
    """Cores that a network occupies, and whether the chip's limits are met."""

    needs = "hardware"
    columns = (
        Column("n_cores", "", "min", "Cores that the network occupies.", known="exact"),
        Column(
            "n_cores_high",
            "",
            "min",
            "Cores that the network may occupy if a compiler needs more than the memory limit.",
            known="exact",
        ),
        Column(
            "fits", "", "max", "1 where the network meets every limit of the chip, else 0.", known="exact"
        ),
    )

    def measure(self, priced: Priced) -> Mapping[str, int | bool]:
        cost = priced.cost
        if not cost.timed:
            return {}
        return {"n_cores": cost.n_cores.value, "n_cores_high": cost.n_cores.high, "fits": cost.fits}
