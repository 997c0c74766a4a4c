"""The head of a CSV file: what separates columns, what decimals begin with, and how columns are called."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from dse.config.bounds import MOST_COLUMNS
from dse.data.recordings import RecordingError

LABEL = "label"
"""Name of the column of a file without names that must be the label."""

BLANKS = r"\s+"
"""Separator of columns of numbers, as numpy.savetxt writes them."""

_SEPARATORS = (",", ";", "\t")
_HEAD_BYTES = 1 << 16
_HEAD_LINES = 40
_MANY, _EVEN = 8, 0.1  # so many numbers that rise evenly are times; a share of a rise
_POINT = re.compile(rb"(?<![\d.])\d+\.\d+(?![\d.])")  # of a number, not of a date

Fields = Sequence["float | str"]
"""A line: its numbers, and texts for what is none."""


class Head(NamedTuple):
    """What separates columns and decimals; names, where the first line has none."""

    separator: str
    decimal: str
    names: list[str] | None


def head_of(path: Path) -> Head:
    """Return the head of a CSV file.

    The separator is the most frequent of comma, semicolon and tab in the first line, or what separates
    numbers there, whose commas are decimal, or blanks between numbers. Commas between the digits of the next
    lines are decimal where they separate no columns, and no number has a point.

    Raises:
        RecordingError: there are too many columns.
    """
    with path.open("rb") as file:
        first, head = file.readline(), file.read(_HEAD_BYTES)
    line, (usual, *others) = first.decode("utf-8-sig", "replace"), _SEPARATORS  # Excel begins with a mark
    others += [] if any(x in line for x in _SEPARATORS) else [BLANKS]
    of_numbers = (x for x in others if _are_numbers(_fields(line.replace(usual, "."), x)))
    separator = next(of_numbers, max(_SEPARATORS, key=line.count))
    if (n := len(_fields(line, separator))) > MOST_COLUMNS:
        raise RecordingError(f"{path.name}: a table must have at most {MOST_COLUMNS} columns, got {n}")
    has_comma = separator != usual and re.search(rb"\d,\d", head) and not _POINT.search(head)
    decimal = "," if has_comma else "."
    lines = [line, *head.decode("utf-8", "replace").splitlines()[:_HEAD_LINES]]
    rows = [[_value(field.replace(decimal, ".")) for field in _fields(x, separator)] for x in lines]
    rows = [row for row in rows if len(row) == n]  # the last line may be cut
    return Head(separator, decimal, None if _are_names(rows) else _numbered(rows))


def _fields(line: str, separator: str) -> list[str]:
    fields = line.split(None if separator == BLANKS else separator)
    return [field.strip().strip('"') for field in fields]


def _are_numbers(fields: Sequence[str]) -> bool:
    return len(fields) > 1 and not any(isinstance(_value(field), str) for field in fields)


def _value(field: str) -> float | str:
    try:
        return field if "_" in field else float(field)
    except ValueError:
        return field


def _are_names(rows: Sequence[Fields]) -> bool:
    """Return whether the first line names columns.

    It does where a text is in no other line, as labels would be, and where numbers count columns, rise evenly
    as times do, or are whole and rise while others have fractions.
    """
    first, *others = rows
    numbers = [x for x in first if not isinstance(x, str)]
    if any(isinstance(x, str) and x not in [row[k] for row in others] for k, x in enumerate(first)):
        return True
    if len(first) == 1:
        return numbers == [0.0]  # as pandas names a column
    is_count = any(numbers == [start + k for k in range(len(numbers))] for start in (0, 1))
    has_fractions = any(not isinstance(x, str) and x % 1 for row in others for x in row)
    are_alike = any(x % 1 for x in numbers) or not has_fractions  # as values of one recording would be
    rises = [b - a for a, b in itertools.pairwise(numbers)] or [0.0]
    are_times = len(numbers) >= _MANY and max(rises) - min(rises) <= _EVEN * min(rises)
    return is_count or (min(rises) > 0 and (are_times or not are_alike))


def _numbered(rows: Sequence[Fields]) -> list[str]:
    """Return names for columns: their numbers, and `label` for a first or last one that alone is no signal.

    That holds texts, or whole numbers where most others have fractions.
    """
    names = [f"{k}" for k in range(len(rows[0]))]
    is_signal = [any(not isinstance(x, str) and x % 1 for x in column) for column in zip(*rows, strict=True)]
    label = next((k for k in (0, -1) if not is_signal[k]), None)
    if label is not None and (2 * sum(is_signal) >= len(names) - 1 or isinstance(rows[0][label], str)):
        names[label] = LABEL
    return names
