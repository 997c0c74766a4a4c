"""Surrogate gradients: what stands for ds/dv in the backward pass."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dse.base.records import Floats
from dse.engine.neurons.fixed_point import STATE_SCALE

OFFSET = 0.01 / STATE_SCALE
"""How far above the threshold SLAYER's surrogate has its centre."""


@dataclass(frozen=True)
class Exponential:
    """SLAYER's double exponential, ds/dv = height * exp(-|v - threshold - OFFSET| / width), in weight units.

    width = 100 * tau_grad * (threshold - rest) and height = 0.1 * scale_grad / (2 * width); `tau_grad` is a
    ratio, not a time. Below `cut` times its height the surrogate is 0 (SLAYER: cut = 0). Width and height are
    numbers, or (neuron,).

    Source: lava-dl SLAYER, `slayer.spike.Spike` (REFERENCES.md).
    """

    width: Floats | float
    height: Floats | float
    cut: float = 0.0

    def exponents(self, threshold: float) -> tuple[float, float, float, float]:
        """Return (centre, rate, height, lowest) of one threshold for all neurons, as kernels read them.

        The surrogate is height * 2**x with x = rate * |v - centre|, and 0 for x < lowest.
        """
        lowest = math.log2(self.cut) if self.cut else -math.inf
        return threshold + OFFSET, -math.log2(math.e) / float(self.width), float(self.height), lowest

    def __call__(self, distance: Floats) -> Floats:
        """Return ds/dv at a distance v - threshold (v before reset, weight units), any shape."""
        share = np.exp(-np.abs(distance - OFFSET) / self.width)
        return np.asarray(self.height * np.where(share > self.cut, share, np.zeros_like(share)))


def exponential(
    to_threshold: Floats | float, tau_grad: float, scale_grad: float, cut: float = 0.0
) -> Exponential:
    """Return the surrogate of neurons, given how far their threshold lies above rest (weight units).

    Raises:
        ValueError: tau_grad or scale_grad is not positive, or cut is outside [0, 1).
    """
    if not 0 <= cut < 1:
        raise ValueError(f"cut must be within [0, 1), got {cut}")
    if not (tau_grad > 0 and scale_grad > 0):
        raise ValueError(f"tau_grad and scale_grad must be > 0, got {tau_grad} and {scale_grad}")
    width = 100 * tau_grad * to_threshold
    return Exponential(width, 0.1 * scale_grad / (2 * width), cut)
