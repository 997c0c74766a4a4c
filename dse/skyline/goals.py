"""Goals: columns of a table to maximise or to minimise."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import pandas as pd

from dse.records import Floats
from dse.skyline.constraints import ExpressionError
from dse.skyline.table import numbers


class Goal(NamedTuple):
    """A column and its direction: 'max' or 'min'."""

    column: str
    direction: str

    @property
    def sign(self) -> float:
        """The factor that turns values into costs, which are minimised."""
        return 1.0 if self.direction == "min" else -1.0


def checked_goals(pairs: Iterable[tuple[str, str]]) -> list[Goal]:
    """Return (column, direction) pairs as goals.

    Raises:
        ExpressionError: there is none, a direction is unknown, or a column is named twice.
    """
    goals = [Goal(*pair) for pair in pairs]
    if not goals:
        raise ExpressionError("objectives must hold at least one column, e.g. accuracy:max")
    for name, direction in goals:
        if direction not in ("max", "min"):
            raise ExpressionError(f"objective '{name}' must be followed by :max or :min, got '{direction}'")
    names = [goal.column for goal in goals]
    twice = [name for name in dict.fromkeys(names) if names.count(name) > 1]
    if twice:
        raise ExpressionError(f"objective '{twice[0]}' is named twice")
    return goals


def parse_goals(text: str) -> list[Goal]:
    """Return the goals that "accuracy:max,energy_uj:min" names.

    Raises:
        ExpressionError: a direction is missing or unknown, or a column is named twice.
    """
    goals = []
    for part in text.split(","):
        name, _, direction = (x.strip() for x in part.partition(":"))
        goals.append((name, direction))
    return checked_goals(goals)


def costs_of(frame: pd.DataFrame, goals: Iterable[Goal]) -> Floats:
    """Return the goals' columns as costs, (row, goal), all minimised.

    Raises:
        ExpressionError: an unknown column, or one that holds no numbers.
    """
    return np.stack([goal.sign * numbers(frame, goal.column) for goal in goals], axis=1)
