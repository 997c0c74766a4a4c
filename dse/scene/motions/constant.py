"""A constant speed, reached by a short ramp as a robot arm reaches it.

v(t) = min(A t, V);   x(T) = D at  T = D / V + V / (2 A)   (sqrt(2 D / A) where V is never reached)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dse.base.records import Floats
from dse.base.registry import fixed, param, register


@register("scene.motions", "constant")
@dataclass(frozen=True)
class Constant:
    """Constant speed after a short ramp; at 0 mm/s the tip presses and does not move."""

    speed_mm_s: float = param(doc="speed V after the ramp", unit="mm/s", low=0)
    travel_mm: float = param(
        84.0, doc="length D of the path, after which the tip stops [A]", unit="mm", low=0, low_open=True
    )
    acceleration_mm_s2: float = param(
        300.0, doc="acceleration A of the ramp [A]", unit="mm/s2", low=0, low_open=True
    )
    name: str = fixed("", doc="class name (default: kind and speed)")

    @property
    def label(self) -> str:
        """The given name, else such as constant_17.5."""
        return self.name or f"constant_{self.speed_mm_s:g}"

    @property
    def peak_mm_s(self) -> float:
        """Highest speed, below V where the travel ends on the ramp."""
        return min(self.speed_mm_s, math.sqrt(2 * self.acceleration_mm_s2 * self.travel_mm))

    @property
    def duration_s(self) -> float:
        """Time at which the travel is done; infinite at 0 mm/s."""
        if self.speed_mm_s == 0:
            return math.inf
        v = self.peak_mm_s
        return self.travel_mm / v + v / (2 * self.acceleration_mm_s2)

    def speed(self, t_s: Floats) -> Floats:
        """Return the speed in mm/s at times (n,) from motion onset."""
        return np.asarray(np.minimum(self.acceleration_mm_s2 * t_s, self.speed_mm_s))
