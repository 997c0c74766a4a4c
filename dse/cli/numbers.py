"""Numbers on the command line."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable


def positive(text: str) -> int:
    """Return an integer of at least 1.

    Raises:
        argparse.ArgumentTypeError: it is none.
    """
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be an integer >= 1, got '{text}'")
    return int(text)


MOST_DRAWS = 100_000


def draws(text: str) -> int:
    """Return how often figures are drawn.

    Raises:
        argparse.ArgumentTypeError: it is no integer from 1 to 100 000.
    """
    found = positive(text)
    if found > MOST_DRAWS:
        raise argparse.ArgumentTypeError(f"must be at most {MOST_DRAWS}, got {found}")
    return found


def amount(text: str) -> float:
    """Return a finite number of at least 0.

    Raises:
        argparse.ArgumentTypeError: it is none.
    """
    return _number(text, lambda x: 0 <= x < math.inf, "a finite number >= 0")


def share(text: str) -> float:
    """Return a number above 0 and up to 1.

    Raises:
        argparse.ArgumentTypeError: it is none.
    """
    return _number(text, lambda x: 0 < x <= 1, "a number above 0 and up to 1")


def _number(text: str, is_good: Callable[[float], bool], wanted: str) -> float:
    try:
        found = float(text)
    except ValueError:
        found = math.nan
    if not is_good(found):
        raise argparse.ArgumentTypeError(f"must be {wanted}, got '{text}'")
    return found


def port(text: str) -> int:
    """Return a number of a port, 0 for any.

    Raises:
        argparse.ArgumentTypeError: it is no integer from 0 to 65 535.
    """
    if not text.isdecimal() or int(text) > 65_535:
        raise argparse.ArgumentTypeError(f"must be an integer from 0 to 65535, got '{text}'")
    return int(text)
