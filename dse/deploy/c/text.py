"""Pieces of C text: templates, constants, lines."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence
from pathlib import Path
from string import Template

from dse.text import c_characters

TITLE, NAMES = "@TITLE@", "@NAMES@"
"""What stands for the title and the names of classes while names in C get their prefix."""

_TEMPLATES = Path(__file__).parent / "templates"
_LONGEST_STRING = 4096  # what C99 wants every compiler to take, the null at its end included


def filled(template: str, **values: object) -> str:
    """Return the text of a template with its values."""
    text = (_TEMPLATES / template).read_text(encoding="utf-8")
    return Template(text).substitute(values)


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
