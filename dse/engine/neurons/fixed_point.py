"""The grid of integer arithmetic, as SLAYER trains on it and Loihi runs it: weights of 8 bits, states of 24.

Source: lava-dl SLAYER; Davies et al. 2018 (REFERENCES.md).
"""

from __future__ import annotations

import numpy as np

from dse.base.records import Array, Bools, Floats, Ints

STATE_SCALE = 4096
"""Units of an integer state per weight unit."""
WEIGHT_SCALE = 64
"""Units of a weight's and a threshold's mantissa per weight unit."""
DECAY_SCALE = 4096
BITS = 8
"""Bits of a weight as trained."""
LOWEST_WEIGHT, HIGHEST_WEIGHT = -256 / WEIGHT_SCALE, 254 / WEIGHT_SCALE
"""Ends of 8-bit weights, weight units."""
STATE_LIMIT = 2**23 - 1
"""Largest magnitude (integer units) that Loihi's signed 24-bit state registers hold."""


def quantise(weight: Array) -> Floats:
    """Round weights to 8 bits: half to even on a grid of 1/32, clipped to [-4, 254/64], float32."""
    grid = np.float32(2 / WEIGHT_SCALE)
    rounded = np.round(np.asarray(weight, np.float32) / grid) * grid
    return np.clip(rounded, LOWEST_WEIGHT, HIGHEST_WEIGHT).astype(np.float32)


def in_steps(weight: Array) -> Ints:
    """Return weights of 8 bits in steps of their grid, int64."""
    return np.rint(np.asarray(weight, np.float64) * (WEIGHT_SCALE // 2)).astype(np.int64)


def common_exponent(weights: Ints) -> int:
    """Return the largest e so that all of some whole numbers are multiples of 2^e; 0 if all are 0."""
    common = int(np.bitwise_or.reduce(weights, axis=None))
    return max((common & -common).bit_length() - 1, 0)


def needed_bits(weights: Ints) -> int:
    """Return the bits of the widest of some whole numbers in two's complement, less common factors of 2."""
    q = weights >> common_exponent(weights)
    return 1 + max(int(q.max(initial=0)), ~int(q.min(initial=0))).bit_length()


def quantise_passes(weight: Array) -> Bools:
    """Return where the straight-through gradient of `quantise` survives: inside the clip, ends included."""
    grid = np.float32(2 / WEIGHT_SCALE)
    rounded = np.round(np.asarray(weight, np.float32) / grid) * grid
    return np.asarray((rounded >= LOWEST_WEIGHT) & (rounded <= HIGHEST_WEIGHT))


def within_range(weight: Array) -> Floats:
    """Return master weights clipped to the range of 8 bits, float32: beyond it they have no gradient.

    Source: Courbariaux et al. 2015, section 2.4 (REFERENCES.md).
    """
    return np.clip(weight, LOWEST_WEIGHT, HIGHEST_WEIGHT).astype(np.float32)
