"""Energy per inference on a chip, and its power between inferences (`dse.hardware.cost`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from dse.measure.objectives import Priced
from dse.records import Array
from dse.registry import Column, register


@register("objectives", "energy")
@dataclass(frozen=True)
class Energy:
    """Energies with their intervals; of counted operations, those that are computed alone."""

    needs = "hardware"
    columns = (
        Column(
            "energy_uj",
            "uJ",
            "min",
            "Energy per inference at full speed: dynamic energy, plus static power while computing.",
            known="bound",
        ),
        Column(
            "energy_uj_low",
            "uJ",
            "min",
            "Energy with every number of the hardware profile at its low end.",
            known="bound",
        ),
        Column(
            "energy_uj_high",
            "uJ",
            "min",
            "Energy with every number of the hardware profile at its high end.",
            known="bound",
        ),
        Column(
            "energy_throttled_uj",
            "uJ",
            "min",
            "Energy per inference with static power at the sensor's step period.",
            known="bound",
        ),
        Column(
            "energy_throttled_uj_low",
            "uJ",
            "min",
            "The same with every number at its low end.",
            known="bound",
        ),
        Column(
            "energy_throttled_uj_high",
            "uJ",
            "min",
            "The same with every number at its high end.",
            known="bound",
        ),
        Column(
            "energy_dynamic_uj",
            "uJ",
            "min",
            "Dynamic energy per inference, without static power.",
            known="bound",
        ),
        Column("energy_static_uj", "uJ", "min", "Static energy per inference at full speed.", known="bound"),
        Column(
            "energy_static_throttled_uj",
            "uJ",
            "min",
            "Static energy per inference at the sensor's step period.",
        ),
        Column("idle_mw", "mW", "min", "Power between inferences, while the chip is idle."),
    )

    def measure(self, priced: Priced) -> Mapping[str, Array | float]:
        cost = priced.cost
        energies: dict[str, Array | float] = {**cost.energy_uj.columns("energy_uj")}
        if not cost.timed:
            return energies
        return energies | {
            "energy_dynamic_uj": cost.dynamic_uj,
            "energy_static_uj": cost.static_uj.value,
            "energy_static_throttled_uj": cost.static_throttled_uj.value,
            **cost.energy_throttled_uj.columns("energy_throttled_uj"),
            "idle_mw": cost.idle_mw,
        }
