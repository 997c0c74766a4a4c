"""Pieces of C text: templates, constants, lines."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from string import Template
from typing import Any

from dse.text import c_characters

TITLE, NAMES = "@TITLE@", "@NAMES@"
"""What stands for the title and the names of classes while names in C get their prefix."""

_TEMPLATES = Path(__file__).parent / "templates"
_LONGEST_STRING = 4096  # what C99 wants every compiler to take, the null at its end included


def filled(template: str | Path, **values: Any) -> str:
    """Return the text of a template, here or at a path, with values: `$name` in a line, and blocks of lines.

    @if NAME ... @else ... @end     where a value is true, or else; `@if not NAME` where it is not
    @each NAME ... @end             once for each mapping of a sequence, whose values come first
    """
    text = (_TEMPLATES / template).read_text(encoding="utf-8")
    return "".join(_filled(text.splitlines(keepends=True), values))


def _filled(lines: Iterable[str], values: Mapping[str, Any]) -> Iterator[str]:
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
                yield from _filled(block, {**values, **each})
        else:
            yield Template(line).substitute(values)


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
