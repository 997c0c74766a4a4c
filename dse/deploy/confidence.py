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
    high = _extreme(least, total, largest=False)
    low = _extreme(least - 1, total, largest=True)
    # The smallest denominator d with a fraction n / d in (low, high], of which it has one.
    n = total * high.numerator // high.denominator
    first = int(np.argmax(n * low.denominator > total * low.numerator))
    return Fraction(int(n[first]), int(total[first]))


def _extreme(numerator: Ints, denominator: Ints, *, largest: bool) -> Fraction:
    """Return the smallest or largest of some fractions, exactly."""
    quotient = numerator / denominator
    edge = quotient.max() if largest else quotient.min()
    near = np.flatnonzero(np.abs(quotient - edge) <= 1e-12)
    choose = max if largest else min
    return choose(Fraction(int(numerator[i]), int(denominator[i])) for i in near)
