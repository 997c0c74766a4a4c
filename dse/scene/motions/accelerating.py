"""A constant acceleration from rest.

v(t) = V t / T;   x(T) = D at  T = 2 D / V
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dse.base.records import Floats
from dse.base.registry import fixed, param, register


@register("scene.motions", "accelerating")
@dataclass(frozen=True)
class Accelerating:
    """Speed that rises linearly from rest to its peak at the end of the path."""

    peak_mm_s: float = param(doc="speed V at the end of the path", unit="mm/s", low=0, low_open=True)
    travel_mm: float = param(
        84.0, doc="length D of the path, after which the tip stops [A]", unit="mm", low=0, low_open=True
    )
    name: str = fixed("", doc="class name (default: kind and peak speed)")

    @property
    def label(self) -> str:
        """The given name, else such as accelerating_35."""
        return self.name or f"accelerating_{self.peak_mm_s:g}"

    @property
    def duration_s(self) -> float:
        """Time at which the travel is done."""
        return 2 * self.travel_mm / self.peak_mm_s

    def speed(self, t_s: Floats) -> Floats:
        """Return the speed in mm/s at times (n,) from motion onset."""
        return np.asarray(self.peak_mm_s * t_s / self.duration_s)
