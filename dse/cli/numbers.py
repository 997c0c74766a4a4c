"""Numbers on the command line: functions for `type=` of argparse."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable


def positive(text: str) -> int:
    """Return an integer of at least 1.

    Raises:
        argparse.ArgumentTypeError: the text is none.
    """
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be an integer >= 1, got '{text}'")
    return int(text)


MOST_DRAWS = 100_000


def draws(text: str) -> int:
    """Return a number of samples, an integer from 1 to 100 000.

    Raises:
        argparse.ArgumentTypeError: the text is none.
    """
    n_draws = positive(text)
    if n_draws > MOST_DRAWS:
        raise argparse.ArgumentTypeError(f"must be at most {MOST_DRAWS}, got {n_draws}")
    return n_draws


def amount(text: str) -> float:
    """Return a finite number of at least 0.

    Raises:
        argparse.ArgumentTypeError: the text is none.
    """
    return _number(text, lambda x: 0 <= x < math.inf, "a finite number >= 0")


def fraction(text: str) -> float:
    """Return a number greater than 0 and at most 1.

    Raises:
        argparse.ArgumentTypeError: the text is none.
    """
    return _number(text, lambda x: 0 < x <= 1, "a number > 0 and <= 1")


def _number(text: str, is_valid: Callable[[float], bool], must_be: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not is_valid(number):
        raise argparse.ArgumentTypeError(f"must be {must_be}, got '{text}'")
    return number


def port(text: str) -> int:
    """Return a TCP port, an integer from 0 to 65 535; 0 stands for any free port.

    Raises:
        argparse.ArgumentTypeError: the text is none.
    """
    if not text.isdecimal() or int(text) > 65_535:
        raise argparse.ArgumentTypeError(f"must be an integer from 0 to 65535, got '{text}'")
    return int(text)
