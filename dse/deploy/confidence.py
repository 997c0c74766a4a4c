"""The confidence rule in whole numbers: best / total >= theta, exactly as float64 compares it.

The engine divides in float64 and compares with theta. Rounding keeps order, so among all fractions m / S with
S up to the largest total, those that pass lie above those that do not. Any fraction between the two sides
decides alike; the simplest is taken: 7 / 20 for theta = 0.35.
"""

from __future__ import annotations

import functools
from fractions import Fraction

import numpy as np

from dse.records import Ints


@functools.lru_cache(maxsize=1024)
def simplest_fraction(theta: float, largest_total: int) -> Fraction:
    """Return the fraction f with m / S >= f exactly where float64(m / S) >= theta, for 0 <= m <= S.

    Args:
        theta: in [0, 1].
        largest_total: largest S, >= 1.
    """
    if theta <= 0:
        return Fraction(0)
    total = np.arange(1, max(1, largest_total) + 1, dtype=np.int64)
    least = np.ceil(theta * total).astype(np.int64) + 1
    while (lower := (least > 0) & ((least - 1) / total >= theta)).any():
        least -= lower
    passing = _extreme(least, total, largest=False)
    failing = _extreme(least - 1, total, largest=True)
    return _between(failing, passing)


def _extreme(numerator: Ints, denominator: Ints, *, largest: bool) -> Fraction:
    """Return the smallest or largest of some fractions, exactly."""
    quotient = numerator / denominator
    edge = quotient.max() if largest else quotient.min()
    near = np.flatnonzero(np.abs(quotient - edge) <= 1e-12)
    choose = max if largest else min
    return choose(Fraction(int(numerator[i]), int(denominator[i])) for i in near)


def _between(low: Fraction, high: Fraction) -> Fraction:
    """Return the fraction with the smallest denominator in (low, high] (Stern-Brocot tree)."""
    whole = low.numerator // low.denominator
    if Fraction(whole + 1) <= high:
        return Fraction(whole + 1)
    # Both lie in [whole, whole + 1]: f = whole + 1 / g with g in [1 / (high - whole), 1 / (low - whole)).
    near, far = high - whole, low - whole
    g = _from(1 / near, None if far == 0 else 1 / far)
    return whole + 1 / g


def _from(low: Fraction, high: Fraction | None) -> Fraction:
    """Return the fraction with the smallest denominator in [low, high); without `high`, in [low, inf)."""
    whole = -(-low.numerator // low.denominator)
    if high is None or Fraction(whole) < high:
        return Fraction(whole)
    floor = low.numerator // low.denominator
    # f = floor + 1 / g with g in (1 / (high - floor), 1 / (low - floor)].
    return floor + 1 / _between(1 / (high - floor), 1 / (low - floor))
