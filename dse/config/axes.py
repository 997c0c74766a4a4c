"""An axis of the search space, written in place of a value.

`{choice: [a, b]}`: these values.
`{range: [lo, hi], step: s}`: lo, lo + s, ... up to hi.
`{range: [lo, hi]}`: every number between; for an integer key every integer.
`{range: [lo, hi], log: true}`: the same on a logarithmic scale, for samplers only.

Where a section is a choice of components, their names are an axis (`model.kind`), and the axes of one of them
are there only in designs of that kind (`model.elm.hidden`). Likewise where a key names a component, such as
`model.neuron`: axes of keys that only some of its components have are there only in designs with these.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeGuard

from dse.config.faults import known_names
from dse.config.values import INVALID, Hint, Report, dotted, echo, is_list, number_type, plain
from dse.config.yaml_lines import Path, Raw

_KEYS = ("choice", "range", "step", "log")
_MOST_VALUES = 100_000
# Decimal steps such as 0.05 are not binary fractions; 12 digits hide it and keep 0.15 equal to 0.15.
_DIGITS = 12


@dataclass(frozen=True)
class Axis:
    """A named dimension of the search space.

    name: dotted key, such as `model.hidden`; the column name in every table.
    values: the values in order, or None where any number between low and high is a design.
    low, high: bounds of a range, both included; None for a choice.
    step: distance of two values of a stepped range.
    log: samplers draw the logarithm uniformly.
    is_int: numbers are integers.
    is_list: the key holds a list; a single value stands for a list of one.
    condition: (name of an axis, one or more of its values) of the designs that have this axis; None: all.
    """

    name: str
    values: tuple[Raw, ...] | None
    low: float | None = None
    high: float | None = None
    step: float | None = None
    log: bool = False
    is_int: bool = False
    is_list: bool = False
    condition: tuple[str, ...] | None = None

    def is_in(self, design: Mapping[str, Raw]) -> bool:
        """Return whether a design has this axis, given its values on the axes that conditions name."""
        return self.condition is None or design.get(self.condition[0]) in self.condition[1:]

    def contains(self, value: Raw) -> bool:
        """Return whether the value is on this axis."""
        if self.values is not None:
            return any(type(value) is type(known) and value == known for known in self.values)
        if not _is_number(value) or (self.is_int and not isinstance(value, int)):
            return False
        return self.low is not None and self.high is not None and self.low <= value <= self.high

    def extremes(self) -> tuple[Raw, ...]:
        """Return the values that a component must accept for the whole axis to be legal."""
        return self.values if self.values is not None else (self.low, self.high)

    def wrapped(self, value: Raw) -> Raw:
        """Return the value as its key holds it: a list of one where it stands for that."""
        return (value,) if self.is_list and not isinstance(value, tuple) else value

    @property
    def place(self) -> tuple[str, str]:
        """Section and key of a resolved design that take the value."""
        section, *_, key = self.name.split(".")
        return section, key

    @property
    def is_plain(self) -> bool:
        """Whether tables hold the values themselves: all are numbers, texts or booleans. Others are JSON."""
        kinds = {
            bool if isinstance(v, bool) else float if isinstance(v, int | float) else type(v)
            for v in self.values or ()
        }
        return len(kinds) <= 1 and not kinds & {tuple, list, dict}

    def cell(self, value: object) -> object:
        """Return a value as tables hold it: itself, or JSON text."""
        return value if self.is_plain else json.dumps(_short(value))

    @property
    def is_text(self) -> bool:
        """Whether tables hold text on this axis."""
        return not self.is_plain or any(isinstance(v, str) for v in self.values or ())

    def to_plain(self) -> dict[str, Raw]:
        """Return the axis as it is written in YAML."""
        if self.low is None:
            return {"choice": list(self.values or ())}
        plain: dict[str, Raw] = {"range": [self.low, self.high]}
        if self.step is not None:
            plain["step"] = self.step
        return plain | ({"log": True} if self.log else {})


@dataclass(frozen=True)
class Branching:
    """An axis that every design has, with the axes that each of its values brings along.

    below: value -> axes that only designs with this value have; values that bring none are absent.
    """

    axis: Axis
    below: dict[Raw, list[Axis]]

    @cached_property
    def sizes(self) -> dict[Raw, int]:
        """Value -> number of designs, for axes that all have values and a value that brings others along."""
        return {
            value: math.prod(len(inner.values or ()) for inner in self.below.get(value, ()))
            for value in self.axis.values or ()
        }

    @cached_property
    def size(self) -> int:
        """Number of designs, for axes that all have values."""
        return sum(self.sizes.values()) if self.below else len(self.axis.values or ())


def _short(value: object) -> object:
    """Return a value whose whole floats are integers, as people write them: [1, 2.5], not [1.0, 2.5]."""
    if isinstance(value, list | tuple):
        return [_short(inner) for inner in value]
    return int(value) if isinstance(value, float) and value.is_integer() else value


def branchings(axes: Iterable[Axis]) -> list[Branching]:
    """Return the axes that every design has, in their order, each with those that depend on it."""
    by_name: dict[str, Branching] = {}
    for axis in axes:
        if axis.condition is None:
            by_name[axis.name] = Branching(axis, {})
        else:
            parent, *values = axis.condition
            for value in values:
                by_name[parent].below.setdefault(value, []).append(axis)
    return list(by_name.values())


def n_combinations(axes: Iterable[Axis]) -> int | None:
    """Return the number of designs over some axes, or None where one is a range without steps."""
    known = list(axes)
    if any(axis.values is None for axis in known):
        return None
    return math.prod(branching.size for branching in branchings(known))


def is_axis(value: Raw) -> bool:
    """Return whether a YAML value declares an axis."""
    return isinstance(value, dict) and ("choice" in value or "range" in value)


def stepped(low: float, high: float, step: float) -> tuple[float, ...]:
    """Return low, low + step, ... up to high (included where it is hit), free of rounding creep."""
    count = int((high - low) / step + 1e-9) + 1
    if all(isinstance(number, int) for number in (low, high, step)):
        return tuple(low + index * step for index in range(count))
    return tuple(round(low + index * step, _DIGITS) for index in range(count))


def parse_axis(
    raw: dict[str, Raw],
    hint: Hint,
    path: Path,
    report: Report,
    read_value: Callable[[Raw, Path], Any],
) -> Axis | Any:
    """Return the axis, or INVALID after reporting every mistake in it.

    read_value: validates one value of the key at a path, INVALID if it is none.
    """
    name = dotted(path)
    unknown = [key for key in raw if key not in _KEYS]
    for key in unknown:
        report((*path, key), f"unknown key '{name}.{key}'; {known_names(key, _KEYS)}")
    if "choice" in raw:
        for key in sorted(set(raw) & {"range", "step", "log"}):
            report((*path, key), f"{name} has a choice and cannot also have '{key}'")
        axis = _choice(raw["choice"], is_list(hint), path, report, read_value)
    else:
        axis = _range(raw, hint, path, report, read_value)
    return INVALID if unknown else axis


def _choice(
    raw: Raw, listed: bool, path: Path, report: Report, read_value: Callable[[Raw, Path], Any]
) -> Axis | Any:
    where, name = (*path, "choice"), dotted(path)
    if not isinstance(raw, list | tuple) or not raw:
        report(where, f"{name}.choice must be a list of one or more values, got {echo(raw)}")
        return INVALID
    typed = [read_value(value, (*where, index)) for index, value in enumerate(raw)]
    if any(value is INVALID for value in typed):
        return INVALID
    values = list(map(plain, typed))  # a design is plain data: its seed and its row follow from it
    if listed and all(isinstance(value, tuple) and len(value) == 1 for value in values):
        values = [value[0] for value in values]  # plain numbers make a readable column of a table
    for index, value in enumerate(values):
        if any(type(value) is type(other) and value == other for other in values[:index]):
            report((*where, index), f"{name}.choice has {echo(value)} twice")
            return INVALID
    return Axis(name, tuple(values), is_int=all(type(v) is int for v in values), is_list=listed)


def _range(
    raw: dict[str, Raw], hint: Hint, path: Path, report: Report, read_value: Callable[[Raw, Path], Any]
) -> Axis | Any:
    where, name = (*path, "range"), dotted(path)
    kind, anything, listed = number_type(hint), hint in (Any, object), is_list(hint)
    if kind is None and not anything:
        report(where, f"{name} is not a number and must be a choice, got a range")
        return INVALID
    ends = raw["range"]
    if not isinstance(ends, list | tuple) or len(ends) != 2 or not all(map(_is_number, ends)):
        report(where, f"{name}.range must be two numbers [low, high], got {echo(ends)}")
        return INVALID
    ends = [read_value(end, (*where, index)) for index, end in enumerate(ends)]
    if any(end is INVALID for end in ends):
        return INVALID
    low, high = (end[0] if isinstance(end, tuple) else end for end in ends)
    step, log = raw.get("step"), raw.get("log", False)
    is_int = kind is int or (anything and all(type(number) is int for number in (low, high, step or 0)))
    faults: list[tuple[str, str]] = []
    if low >= high:
        faults.append(("range", f".range must be in increasing order, got [{echo(low)}, {echo(high)}]"))
    if not isinstance(log, bool):
        faults.append(("log", f".log must be true or false, got {echo(log)}"))
    elif log and low <= 0:
        faults.append(("range", f".range must start above 0 for log: true, got {echo(low)}"))
    elif log and step is not None:
        faults.append(("step", " has log: true and cannot also have a step"))
    if step is not None and (not _is_number(step) or step <= 0 or (is_int and type(step) is not int)):
        faults.append(
            ("step", f".step must be {'an integer' if is_int else 'a number'} > 0, got {echo(step)}")
        )
    for key, text in faults:
        report((*path, key), f"{name}{text}")
    if faults:
        return INVALID
    assert isinstance(log, bool) and (step is None or _is_number(step))
    step = 1 if is_int and step is None and not log else step
    if step is None:
        return Axis(name, None, low, high, None, log, is_int, listed)
    if not is_int:
        step = float(step)
    if (high - low) / step >= _MOST_VALUES:
        report(where, f"{name}.range has more than {_MOST_VALUES} values; use a larger step")
        return INVALID
    return Axis(name, stepped(low, high, step), low, high, step, False, is_int, listed)


def _is_number(value: Raw) -> TypeGuard[int | float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
