"""Objectives: what a column of the record means, its unit, and which way is better.

Each file measures one thing with pure functions of arrays and records; nothing reads files here.
To add one: a file with a function under `@objective(...)`; `known()` finds it by itself.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeVar

Direction = Literal["max", "min"]
F = TypeVar("F", bound=Callable[..., object])


@dataclass(frozen=True)
class Objective:
    """One column: its unit ('' for a plain number), the better direction and one line of meaning."""

    unit: str
    direction: Direction
    doc: str


_objectives: dict[str, Objective] = {}


def declare(name: str, unit: str, direction: Direction, doc: str) -> None:
    """Declare a column that another part of the package measures.

    Raises:
        ValueError: the column is declared already, as something else.
    """
    new = Objective(unit, direction, doc)
    if _objectives.setdefault(name, new) != new:
        raise ValueError(f"column '{name}' is declared twice")


def objective(unit: str, direction: Direction) -> Callable[[F], F]:
    """Declare the column that a function measures: its name and the first line of its docstring."""

    def decorate(function: F) -> F:
        declare(function.__name__, unit, direction, (function.__doc__ or "").strip().splitlines()[0])
        return function

    return decorate


def known() -> dict[str, Objective]:
    """Return every objective by column name."""
    for module in pkgutil.iter_modules(__path__):
        importlib.import_module(f"{__name__}.{module.name}")
    return dict(sorted(_objectives.items()))
