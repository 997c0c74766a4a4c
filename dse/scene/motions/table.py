"""Any profile: speeds at given times, straight lines between them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dse.base.records import Floats
from dse.base.registry import fixed, register


@register("scene.motions", "table")
@dataclass(frozen=True)
class Table:
    """Speeds at given times, e.g. from the log of a robot, interpolated linearly."""

    t_s: tuple[float, ...] = fixed(doc="times from motion onset, rising from 0", unit="s", low=0)
    v_mm_s: tuple[float, ...] = fixed(doc="speed at each of the times t_s", unit="mm/s", low=0)
    name: str = fixed("", doc="class name (default: kind and peak speed)")

    def __post_init__(self) -> None:
        if len(self.t_s) < 2 or self.t_s[0] != 0 or any(b <= a for a, b in pairwise(self.t_s)):
            raise ValueError(
                f"t_s must start at 0, increase, and hold at least two times, got {list(self.t_s)}"
            )
        if len(self.v_mm_s) != len(self.t_s):
            raise ValueError(
                f"v_mm_s must have one speed for each of {len(self.t_s)} times, got {len(self.v_mm_s)}"
            )

    @property
    def label(self) -> str:
        """The given name, else such as table_60."""
        return self.name or f"table_{self.peak_mm_s:g}"

    @property
    def peak_mm_s(self) -> float:
        """Highest speed."""
        return max(self.v_mm_s)

    @property
    def duration_s(self) -> float:
        """The last time."""
        return self.t_s[-1]

    def speed(self, t_s: Floats) -> Floats:
        """Return the speed in mm/s at times (n,) from motion onset."""
        return np.asarray(np.interp(t_s, self.t_s, self.v_mm_s))
