"""Printed numbers and ours as text, and whether they agree."""

from __future__ import annotations

import math

from dse_papers.report.facts import Fact
from dse_papers.report.papers import Value

WITHIN = "within one standard error"
_LARGE = 1e5


def as_number(value: Value | Fact) -> float | None:
    """Return a number; None for a range, a text or nothing."""
    return float(value) if isinstance(value, int | float) else None


def text_of(value: Value | Fact) -> str:
    """Return a number as text, a range as `1 to 6`."""
    if isinstance(value, tuple):
        return " to ".join(map(text_of, value))
    if isinstance(value, str) or value is None:
        return value or ""
    return f"{value:.0f}" if 10_000 <= abs(value) < 1e6 else f"{value:.4g}"


def printed_text(value: Value) -> str:
    """Return a printed number as text, with all of its digits."""
    return f"{value:.6g}" if isinstance(value, int | float) else text_of(value)


def agrees(printed: Value, ours: Value | Fact) -> bool:
    """Return whether ours is the printed value of a set-up: a number to half a per cent, all else exactly."""
    if isinstance(printed, tuple) and isinstance(ours, tuple):
        return len(printed) == len(ours) and all(map(agrees, printed, ours))
    if isinstance(printed, int | float) and isinstance(ours, int | float):
        return math.isclose(ours, printed, rel_tol=0.005, abs_tol=1e-12)
    return printed == ours


def rounds_to(printed: float, ours: float) -> bool:
    """Return whether a result of ours is the printed one, to the digits that are printed.

    Fractions are printed in per cent, weights and spikes in 10 000.
    """
    if abs(printed) >= _LARGE:
        return round(ours / 1e4) == round(printed / 1e4)
    decimals = len(f"{printed:.9f}".rstrip("0").partition(".")[2])
    return math.isclose(round(ours, max(decimals, 2) if abs(printed) <= 1 else decimals), printed)


def gap_of(printed: float, ours: float, se: float | None) -> str:
    """Return how far ours is from the printed value: a difference of fractions, else a ratio; '' if alike."""
    difference = ours - printed
    if rounds_to(printed, ours):
        return ""
    if se is not None and abs(difference) <= se:
        return WITHIN
    if (abs(printed) <= 1 and abs(ours) <= 1) or printed == 0:
        return f"{abs(difference):.2g} {'above' if difference > 0 else 'below'}"
    return f"{ours / printed:.2g} times the printed value"
