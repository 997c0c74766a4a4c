"""A whole computer or board of which nothing but power is published: at rest, and while inference goes on.

    energy = (at rest + beyond rest) x length of the input

It keeps pace with the sensor and computes for as long as the input lasts. Power does not depend on the
network, so a platform ranks no network above another.

Sources: those of the profiles (REFERENCES.md).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dse.hardware.plan import Placement, Plan, per_count
from dse.hardware.profile import Figures, Number, Profile, figure
from dse.records import Workload
from dse.registry import register

_ASSUMPTIONS = (
    "it computes for as long as the input lasts",
    "its power is that of the published network, whatever the network",
)


@register("hardware.kinds", "platform")
@dataclass(frozen=True)
class Platform(Profile):
    """A computer or board with published power and nothing else; it runs networks of spiking layers."""

    any_neuron = True

    idle_w: Number = figure("W", "power at rest")
    beyond_idle_w: Number = figure("W", "power in addition while inference goes on")

    def plan_network(self, load: Workload, figures: Figures) -> Plan:
        """Return the plan of a spiking network (`Profile.plan`)."""
        idle_mw, beyond_w = figures["idle_w"] * 1e3, figures["beyond_idle_w"]
        return Plan(
            energy_pj={"beyond_idle": np.multiply.outer(beyond_w, per_count(load, step=load.step_ms * 1e9))},
            time_ns=np.multiply.outer(np.ones_like(beyond_w), per_count(load, step=load.step_ms * 1e6)[None]),
            static_mw=idle_mw,
            idle_mw=idle_mw,
            placement=Placement((1,), assumptions=_ASSUMPTIONS),
            running_mw=idle_mw + beyond_w * 1e3,
        )
