"""The search space as a grid: designs by index, row-major, the last axis fastest."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterator, Mapping

from dse.config.axes import Axis, n_combinations
from dse.config.space import Design, SearchSpace
from dse.config.values import plain
from dse.config.yaml_lines import Raw


def n_designs_of_each(space: SearchSpace, section: str) -> dict[str, int | None]:
    """Return kind -> number of designs, for a section that is a choice of several components."""
    n_of_kind: dict[str, int | None] = {}
    name = f"{section}.kind"
    for kind in space.choices[section]:
        n_of_kind[kind] = n_combinations(
            Axis(name, (kind,)) if axis.name == name else axis
            for axis in space.axes.values()
            if axis.condition is None or axis.condition[0] != name or kind in axis.condition[1:]
        )
    return n_of_kind


def design_at(space: SearchSpace, index: int) -> Design:
    """Return one design of the grid.

    Args:
        space: search space whose axes all have values.
        index: in [0).

    Raises:
        ValueError: an axis is a range without steps, or the index is outside the grid.
    """
    total = space.n_designs
    if total is None or not 0 <= index < total:
        raise ValueError(f"index must be in [0, {total}) of a grid whose axes all have values, got {index}")
    design: Design = {}
    for branching in reversed(space.branchings):
        axis, values = branching.axis, branching.axis.values or ()
        index, place = divmod(index, branching.size)
        if branching.below:
            value, place = _branch(branching.sizes, place)
            design[axis.name] = value
            for inner in reversed(branching.below.get(value, [])):
                place, step = divmod(place, len(inner.values or ()))
                design[inner.name] = (inner.values or ())[step]
        else:
            design[axis.name] = values[place]
    return {name: design[name] for name in space.axes if name in design}


def _branch(sizes: Mapping[Raw, int], place: int) -> tuple[Raw, int]:
    """Return the value whose designs hold a place of the grid, and the place among them."""
    for value, size in sizes.items():
        if place < size:
            return value, place
        place -= size
    raise AssertionError("a place is below the sum of the sizes")


def index_of(space: SearchSpace, design: Mapping[str, Raw]) -> int:
    """Return the place of a design in the grid, the inverse of `design_at`."""
    axes = space.active(design)
    if set(design) != set(axes):
        raise ValueError(f"a design must have the axes {sorted(axes)}, got {sorted(design)}")
    index = 0
    for branching in space.branchings:
        place = position(branching.axis, design[branching.axis.name])
        if branching.below:
            value = (branching.axis.values or ())[place]
            sizes = list(branching.sizes.values())
            inside = 0
            for inner in branching.below.get(value, []):
                inside = inside * len(inner.values or ()) + position(inner, design[inner.name])
            place = sum(sizes[:place]) + inside
        index = index * branching.size + place
    return index


def corners(space: SearchSpace, sections: Collection[str], most: int) -> Iterator[Design]:
    """Yield designs at every choice and at the ends of every range of some sections' axes.

    Other axes have their first value. Every combination of kinds has an equal share of `most`.

    Args:
        space: search space.
        sections: whose axes vary.
        most: designs at most, and one per combination of kinds at least.
    """
    named = {axis.condition[0] for axis in space.axes.values() if axis.condition is not None}
    named |= {f"{section}.kind" for section in space.choices}
    parents = {name: axis.values or () for name, axis in space.axes.items() if name in named}
    kinds = list(itertools.product(*parents.values()))
    for combination in kinds:
        kind_of = dict(zip(parents, combination, strict=True))
        axes = space.active(kind_of)
        ends = [
            (kind_of[name],)
            if name in kind_of
            else axis.extremes()[: None if axis.place[0] in sections else 1]
            for name, axis in axes.items()
        ]
        for values in itertools.islice(itertools.product(*ends), max(1, most // len(kinds))):
            yield dict(zip(axes, values, strict=True))


def position(axis: Axis, value: object) -> int:
    """Return the place of a value among the values of an axis.

    Raises:
        ValueError: it is none of them.
    """
    sought = plain(value)
    for place, known in enumerate(axis.values or ()):
        if known == sought and isinstance(known, bool) == isinstance(sought, bool):
            return place
    raise ValueError(f"{axis.name} must be one of {list(axis.values or ())}, got {value!r}")


def at(axis: Axis, u: float) -> Raw:
    """Return the value of an axis at a coordinate in [0, 1), of equal shares or on its logarithmic scale."""
    if axis.values is not None:
        return axis.values[int(u * len(axis.values))]
    assert axis.low is not None and axis.high is not None  # a range has ends
    # An integer has what is rounded to it: half a step on either side.
    margin = 0.5 if axis.is_int else 0.0
    low, high = axis.low - margin, axis.high + margin
    if axis.log:
        value = math.exp(math.log(low) + u * (math.log(high) - math.log(low)))
    else:
        value = low + u * (high - low)
    return min(max(round(value) if axis.is_int else value, axis.low), axis.high)
