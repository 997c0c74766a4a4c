"""A constant acceleration to half way, then the same deceleration to rest.

v(t) = 2 V t / T up to T / 2, then 2 V (1 - t / T);   x(T) = D at  T = 2 D / V
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dse.base.records import Floats
from dse.base.registry import fixed, param, register


@register("scene.motions", "triangular")
@dataclass(frozen=True)
class Triangular:
    """Speed that rises linearly to its peak half way and falls linearly to rest."""

    peak_mm_s: float = param(doc="peak speed V, reached half way", unit="mm/s", low=0, low_open=True)
    travel_mm: float = param(
        84.0, doc="length D of the path, after which the tip stops [A]", unit="mm", low=0, low_open=True
    )
    name: str = fixed("", doc="class name (default: kind and peak speed)")

    @property
    def label(self) -> str:
        """The given name, else such as triangular_35."""
        return self.name or f"triangular_{self.peak_mm_s:g}"

    @property
    def duration_s(self) -> float:
        """Time at which the travel is done."""
        return 2 * self.travel_mm / self.peak_mm_s

    def speed(self, t_s: Floats) -> Floats:
        """Return the speed in mm/s at times (n,) from motion onset."""
        share = t_s / self.duration_s
        return np.asarray(2 * self.peak_mm_s * np.clip(np.minimum(share, 1 - share), 0, None))
