"""Numbers on the command line."""

from __future__ import annotations

import argparse
import math


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
    try:
        found = float(text)
    except ValueError:
        found = -1.0
    if not 0 <= found < math.inf:
        raise argparse.ArgumentTypeError(f"must be a finite number >= 0, got '{text}'")
    return found


def share(text: str) -> float:
    """Return a number above 0 and up to 1.

    Raises:
        argparse.ArgumentTypeError: it is none.
    """
    try:
        found = float(text)
    except ValueError:
        found = -1.0
    if not 0 < found <= 1:
        raise argparse.ArgumentTypeError(f"must be a number above 0 and up to 1, got '{text}'")
    return found
