"""Surrogate gradients: what stands for ds/dv in the backward pass."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dse.neurons.cuba_lif import STATE_SCALE, WEIGHT_SCALE
from dse.records import Array


@dataclass(frozen=True)
class Exponential:
    """SLAYER's double exponential, ds/dv = height * exp(-|v - centre| / width), in weight units.

    width = 100 * tau_grad * threshold and height = 0.1 * scale_grad / (2 * width); `tau_grad` is a
    ratio of the threshold, not a time. The centre lies 0.01/4096 above the threshold. Below `cut` times its
    height the surrogate is 0 (SLAYER: cut = 0).

    Source: lava-dl SLAYER, `slayer.spike.Spike` (REFERENCES.md).
    """

    centre: float
    width: float
    height: float
    cut: float = 0.0

    def exponents(self) -> tuple[float, float, float, float]:
        """Return (centre, rate, height, lowest): height * 2**x, x = rate * |v - centre|; 0 for x < lowest."""
        lowest = math.log2(self.cut) if self.cut else -math.inf
        return self.centre, -math.log2(math.e) / self.width, self.height, lowest

    def __call__(self, voltage: Array) -> Array:
        """Return ds/dv at a membrane potential (before reset, weight units), any shape."""
        share = np.exp(-np.abs(voltage - self.centre) / self.width)
        return np.asarray(self.height * np.where(share > self.cut, share, np.zeros_like(share)))


def exponential(threshold: int, tau_grad: float, scale_grad: float, cut: float = 0.0) -> Exponential:
    """Return the surrogate of a threshold mantissa (threshold / 64 in weight units).

    Raises:
        ValueError: tau_grad or scale_grad is not positive, or cut is outside [0, 1).
    """
    if not 0 <= cut < 1:
        raise ValueError(f"cut must be within [0, 1), got {cut}")
    if not (tau_grad > 0 and scale_grad > 0):
        raise ValueError(f"tau_grad and scale_grad must be > 0, got {tau_grad} and {scale_grad}")
    real = threshold / WEIGHT_SCALE
    width = 100 * tau_grad * real
    return Exponential(real + 0.01 / STATE_SCALE, width, 0.1 * scale_grad / (2 * width), cut)
