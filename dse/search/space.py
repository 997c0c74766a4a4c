"""The search space as a grid: designs by index, row-major, the last axis fastest."""

from __future__ import annotations

import math

from dse.config.axes import Axis
from dse.config.space import Design, SearchSpace


def n_designs(space: SearchSpace) -> int | None:
    """Return the number of designs, or None where an axis is a range without steps."""
    sizes = [None if axis.values is None else len(axis.values) for axis in space.axes.values()]
    return None if None in sizes else math.prod(size for size in sizes if size is not None)


def design_at(space: SearchSpace, index: int) -> Design:
    """Return one design of the grid.

    Args:
        space: search space whose axes all have values.
        index: in [0, n_designs).

    Raises:
        ValueError: an axis is a range without steps, or the index is outside the grid.
    """
    total = n_designs(space)
    if total is None or not 0 <= index < total:
        raise ValueError(f"index must be in [0, {total}) of a grid whose axes all have values, got {index}")
    design: Design = {}
    for axis in reversed(list(space.axes.values())):
        values = axis.values or ()
        index, position = divmod(index, len(values))
        design[axis.name] = values[position]
    return {name: design[name] for name in space.axes}


def index_of(space: SearchSpace, design: Design) -> int:
    """Return the place of a design in the grid, the inverse of `design_at`.

    Raises:
        ValueError: the design is not in the grid.
    """
    index = 0
    for axis in space.axes.values():
        index = index * len(axis.values or ()) + position(axis, design[axis.name])
    return index


def position(axis: Axis, value: object) -> int:
    """Return the place of a value among the values of an axis.

    Raises:
        ValueError: it is none of them.
    """
    wanted = tuple(value) if isinstance(value, list) else value
    for place, known in enumerate(axis.values or ()):
        if known == wanted and isinstance(known, bool) == isinstance(wanted, bool):
            return place
    raise ValueError(f"{axis.name} must be one of {list(axis.values or ())}, got {value!r}")


def grid(space: SearchSpace) -> list[Design]:
    """Return every design, row-major: the last axis changes fastest.

    Raises:
        ValueError: an axis is a range without steps.
    """
    total = n_designs(space)
    if total is None:
        open_axes = ", ".join(axis.name for axis in space.axes.values() if axis.values is None)
        raise ValueError(f"a grid needs axes with values, got ranges without steps: {open_axes}")
    return [design_at(space, index) for index in range(total)]
