"""Time until the answer: what the sensor needs, and what the hardware adds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dse.hardware.latency import latency_ms
from dse.measure.objectives import Priced
from dse.records import Array, Floats, Operations, Workload
from dse.registry import Column, register


@register("objectives", "latency")
@dataclass(frozen=True)
class Latency:
    """Time of the answer on a chip."""

    needs = "hardware"
    columns = (
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
    )

    def measure(self, priced: Priced) -> Mapping[str, Array]:
        cost = priced.cost
        if not cost.timed:
            return {}
        return {
            "hardware_latency_ms": cost.hardware_latency_ms,
            "latency_ms": latency_of(priced.load, cost.step_time_us.value) + cost.pipeline_ms,
        }


def latency_of(load: Workload | Operations, step_time_us: Floats) -> Floats:
    """Return the time until the answer of some work, without what it still takes through a pipeline."""
    if isinstance(load, Operations):  # computes once, when the input is complete
        return np.asarray(load.duration_ms + step_time_us * 1e-3)
    return latency_ms(load.n_steps * load.step_ms, load.step_ms, step_time_us)
