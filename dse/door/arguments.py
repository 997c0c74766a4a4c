"""Arguments as people write them: one text where a list of texts may stand, wrong types in one sentence."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from dse.skyline.goals import Goal, parse_goals


def texts(value: Any, name: str) -> list[str]:
    """Return a text, or a list of texts, as a list.

    Raises:
        TypeError: it is neither.
    """
    if value is None:
        return []
    if isinstance(value, str):
        return [value]
    items = list(value) if isinstance(value, Iterable) and not isinstance(value, Mapping | bytes) else [value]
    wrong = [item for item in items if not isinstance(item, str)]
    if wrong or isinstance(value, Mapping | bytes):
        raise TypeError(f"{name} must be a text or a list of texts, got {wrong[0] if wrong else value!r}")
    return items


def text(value: Any, name: str) -> str:
    """Return a text.

    Raises:
        TypeError: it is none.
    """
    if not isinstance(value, str):
        raise TypeError(f"{name} must be a text, got {value!r}")
    return value


def goals(value: Any) -> list[Goal]:
    """Return objectives: 'accuracy:max,energy_uj:min', a list of such texts or of pairs, or a mapping.

    Raises:
        TypeError: they are something else.
        ExpressionError: a direction is missing or unknown.
    """
    if isinstance(value, str):
        return parse_goals(value)
    pairs = list(value.items()) if isinstance(value, Mapping) else value
    if not isinstance(pairs, list | tuple):
        raise TypeError(f"objectives must be like 'accuracy:max,energy_uj:min', got {value!r}")
    parsed = []
    for pair in pairs:
        if isinstance(pair, str):
            parsed += parse_goals(pair)
        elif isinstance(pair, tuple | list) and len(pair) == 2 and all(isinstance(x, str) for x in pair):
            parsed.append(Goal(*pair))
        else:
            raise TypeError(f"objectives must be pairs such as ('energy_uj', 'min'), got {pair!r}")
    return parsed


def amount(value: Any, name: str, *, high: float | None = None) -> float | None:
    """Return a number of at least 0, or None.

    Raises:
        TypeError: it is no number.
        ValueError: it is negative or above `high`.
    """
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"{name} must be a number, got {value!r}")
    if not 0 <= value or (high is not None and value > high):
        limit = ">= 0" if high is None else f"in [0, {high:g}]"
        raise ValueError(f"{name} must be {limit}, got {value!r}")
    return float(value)
