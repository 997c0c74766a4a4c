"""Pieces of C text: templates, constants, lines."""

from __future__ import annotations

import functools
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from string import Template
from typing import Any

from dse.base.text import c_characters

TITLE, NAMES = "@TITLE@", "@NAMES@"
"""What stands for the title and the names of classes while names in C get their prefix."""

_TEMPLATES = Path(__file__).parent / "templates"
_LONGEST_STRING = 4096  # what C99 wants every compiler to take, the null at its end included


class _Line(Template):
    idpattern = r"(?a:[a-z_][a-z0-9_]*(?:\.[a-z_][a-z0-9_]*)*)"


class _Values(dict[str, Any]):
    """Values by name; a name that is not there is an attribute of one of some objects, `a.b` one of that."""

    def __init__(self, objects: Sequence[object], values: Mapping[str, Any]) -> None:
        super().__init__(values)
        self.objects = objects

    def __missing__(self, name: str) -> Any:
        first, *others = name.split(".")
        if first in self:
            return functools.reduce(getattr, others, self[first])
        for each in self.objects:
            if hasattr(each, first):
                return functools.reduce(getattr, (first, *others), each)
        raise KeyError(name)

    def inside(self, each: object) -> _Values:
        """Return the values within a block for one of a sequence: a mapping, or an object."""
        if isinstance(each, Mapping):
            return _Values(self.objects, {**self, **each})
        return _Values((each, *self.objects), self)


def filled(template: str | Path, *objects: object, **values: Any) -> str:
    """Return the text of a template, here or at a path: `$name` or `$name.name` in a line, blocks of lines.

    @if NAME ... @else ... @end     where a value is true, or else; `@if not NAME` where it is not
    @each NAME ... @end             once for each mapping or object of a sequence, whose values come first
    @include TEMPLATE               another one, of the same values

    Args:
        template: its name or path.
        objects: their attributes are values too, the first object's first.
        values: come before attributes.
    """
    return "".join(_filled(_lines(_TEMPLATES / template), _Values(objects, values)))


@functools.cache
def _lines(template: Path) -> tuple[str, ...]:
    return tuple(template.read_text(encoding="utf-8").splitlines(keepends=True))


def _filled(lines: Iterable[str], values: _Values) -> Iterator[str]:
    ahead = iter(lines)
    for line in ahead:
        word, *name = line.split()[:3] or [""]
        if word == "@if":
            block, other = _block(ahead)
            is_true = not values[name[1]] if name[0] == "not" else values[name[0]]
            yield from _filled(block if is_true else other, values)
        elif word == "@each":
            block, _ = _block(ahead)
            for each in values[name[0]]:
                yield from _filled(block, values.inside(each))
        elif word == "@include":
            yield from _filled(_lines(_TEMPLATES / _Line(name[0]).substitute(values)), values)
        else:
            yield _Line(line).substitute(values)


def _block(ahead: Iterator[str]) -> tuple[list[str], list[str]]:
    """Take the lines up to the end of a block; return those before and after its @else."""
    parts: tuple[list[str], list[str]] = [], []
    depth, at = 1, 0
    for line in ahead:
        word = line.split(maxsplit=1)[0] if line.strip() else ""
        depth += (word in ("@if", "@each")) - (word == "@end")
        if not depth:
            return parts
        if word == "@else" and depth == 1:
            at = 1
        else:
            parts[at].append(line)
    raise ValueError("a block of a template has no @end")


def indented(text: str) -> str:
    """Return lines, four columns to the right."""
    return textwrap.indent(text, "    ")


def wrapped(numbers: Iterable[str]) -> str:
    """Return numbers, separated by commas, in lines."""
    lines, line = [], "   "
    for number in numbers:
        if len(line) + len(number) > 110:
            lines.append(line)
            line = "   "
        line += f" {number},"
    return "\n".join([*lines, line]) + "\n"


def strings(names: Sequence[str]) -> str:
    """Return what initialises a C array with names, each with a null character after it."""
    characters = [[*c_characters(name), "\\0"] for name in names]
    if sum(map(len, characters)) < _LONGEST_STRING:
        return "\n        ".join(f'"{"".join(name)}"' for name in characters)
    return "{\n" + wrapped(f"'{x}'" for name in characters for x in name) + "}"


def real(x: float) -> str:
    """Return a C constant of exactly this double."""
    return repr(float(x))
