"""What an answer costs on a chip: energy, power, time and cores (`dse.measure.hardware.cost`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from dse.base.records import Array, Floats, Operations, Workload
from dse.base.registry import Column, register
from dse.measure.hardware.duty import latency_ms, on_schedule
from dse.measure.hardware.interval import column_names
from dse.measure.objectives import Number, Priced


def _interval(name: str, unit: str, doc: str, known: Literal["", "bound"]) -> tuple[Column, ...]:
    """Return the columns of a value with its range."""
    _, low, high = column_names(name)
    return (
        Column(name, unit, "min", doc, known=known),
        Column(low, unit, "min", f"Least {name} within the ranges of the profile's numbers.", known=known),
        Column(high, unit, "min", f"Largest {name} within the ranges of the profile's numbers.", known=known),
    )


@register("objectives", "on_chip")
@dataclass(frozen=True)
class OnChip:
    """Costs with their intervals; of counted operations, the energy alone."""

    needs = "hardware"
    columns = (
        *_interval(
            "energy_uj",
            "uJ",
            "Energy per inference at full speed: dynamic energy, plus static power while computing.",
            "bound",
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
        *_interval(
            "energy_throttled_uj",
            "uJ",
            "Energy per inference with static power at the sensor's step period.",
            "bound",
        ),
        *_interval("power_idle_w", "W", "Power at rest; NaN where nobody has published it.", ""),
        *_interval("power_w", "W", "Mean power while an inference is computed at full speed.", ""),
        Column("idle_mw", "mW", "min", "Power between inferences, while the chip is idle."),
        Column(
            "hardware_latency_ms",
            "ms",
            "min",
            "Computing time of the hardware per inference at full speed.",
            known="bound",
        ),
        Column(
            "latency_ms",
            "ms",
            "min",
            "Time from the first touch until the hardware has computed the decision.",
            known="bound",
        ),
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
        Column(
            "power_mw",
            "mW",
            "min",
            "Mean power on the schedule of the study, or at --contacts-per-hour, idle time included.",
            of_section="schedule",
        ),
        Column(
            "energy_per_hour_mj", "mJ", "min", "Energy of an hour on that schedule.", of_section="schedule"
        ),
        Column(
            "battery_days",
            "d",
            "max",
            "How long the battery of the schedule lasts.",
            of_section="schedule.battery_mwh",
        ),
    )

    def measure(self, priced: Priced) -> Mapping[str, Array | Number]:
        cost = priced.cost
        energy: dict[str, Array | Number] = {**cost.energy_uj.columns("energy_uj")}
        if not cost.timed:
            return energy
        timed = energy | {
            "energy_dynamic_uj": cost.dynamic_uj,
            "energy_static_uj": cost.static_uj.value,
            "energy_static_throttled_uj": cost.static_throttled_uj.value,
            **cost.energy_throttled_uj.columns("energy_throttled_uj"),
            **cost.power_idle_w.columns("power_idle_w"),
            **cost.power_w.columns("power_w"),
            "idle_mw": cost.idle_mw,
            "hardware_latency_ms": cost.hardware_latency_ms,
            "latency_ms": latency_of(priced.load, cost.step_time_us.value) + cost.pipeline_ms,
            "n_cores": cost.n_cores.value,
            "n_cores_high": cost.n_cores.high,
            "fits": cost.fits,
        }
        if priced.schedule is None:
            return timed
        contact_ms = np.fmax(cost.hardware_latency_ms, _window_ms(priced.load))
        return timed | on_schedule(priced.schedule, cost.energy_throttled_uj.value, contact_ms, cost.idle_mw)


def _window_ms(load: Workload | Operations) -> Floats:
    """Return how long the input of an answer takes."""
    return np.asarray(load.duration_ms if isinstance(load, Operations) else load.n_steps * load.step_ms)


def latency_of(load: Workload | Operations, step_time_us: Floats) -> Floats:
    """Return the time until the answer of some work, without what it still takes through a pipeline."""
    if isinstance(load, Operations):  # computes once, when the input is complete
        return np.asarray(load.duration_ms + step_time_us * 1e-3)
    return latency_ms(load.n_steps * load.step_ms, load.step_ms, step_time_us)
