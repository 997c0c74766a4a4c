"""Pieces of C text: templates, constants, lines."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from pathlib import Path
from string import Template

_TEMPLATES = Path(__file__).parent / "templates"


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


def string(name: str) -> str:
    """Return a C string; what is not ASCII is written as octal bytes of UTF-8."""
    text = "".join(chr(b) if 32 <= b < 127 and chr(b) not in '"\\?' else f"\\{b:03o}" for b in name.encode())
    return f'"{text}\\0"'


def real(x: float) -> str:
    """Return a C constant of exactly this double."""
    return repr(float(x))
