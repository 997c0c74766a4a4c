"""What is predicted: a label column, its absolute value, or a combination of columns."""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import numpy as np

from dse.base.records import Array, Bools, Head, Ints
from dse.config.faults import known_names
from dse.config.parts import target_columns
from dse.config.settings import Column, Target
from dse.data.recordings import RecordingError


def target(columns: Mapping[str, Array], task_target: Target) -> tuple[Ints, tuple[str, ...]]:
    """Return codes (n,) int64 and the names of the classes, in the order of their values.

    columns: label columns, each (n,). task_target: a column's name, a `Column`, or several, joined by `|`.

    Raises:
        RecordingError: an unknown column, `abs` of texts, or two combinations of one name.
    """
    parts = [_values(columns, x) for x in _parts(task_target)]
    unique, inverse = zip(*(np.unique(x, return_inverse=True) for x in parts), strict=True)
    joint = np.ravel_multi_index(tuple(inverse), [len(x) for x in unique])
    present, codes = np.unique(np.asarray(joint), return_inverse=True)
    names = ["|".join(map(_text, x)) for x in itertools.product(*unique)]
    classes = tuple(names[i] for i in present)
    if len(set(classes)) < len(classes):
        twice = next(x for x in classes if classes.count(x) > 1)
        raise RecordingError(f"task.target: two combinations of labels have the same name '{twice}'")
    return codes.astype(np.int64), classes


def heads(columns: Mapping[str, Array], task_target: Target, codes: Ints) -> tuple[Head, ...]:
    """Return the parts of a joint target, each with its classes in the order that `target` gives them.

    codes: (n,) joint classes, which are 0 .. and all in use; -1 for recordings that are not.

    Raises:
        RecordingError: a single column, or one column twice.
    """
    names = target_columns(task_target)
    if len(names) < 2:
        raise RecordingError(
            f"task.joint needs at least two columns in task.target, got {', '.join(map(str, names))}"
        )
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise RecordingError(f"task.joint needs distinct columns in task.target, got '{twice}' twice")
    used = np.flatnonzero(codes >= 0)
    _, first = np.unique(codes[used], return_index=True)
    parts = []
    for name, part in zip(names, _parts(task_target), strict=True):
        codes_of_part, classes = target(columns, part)
        present, of_class = np.unique(codes_of_part[used[first]], return_inverse=True)
        parts.append(Head(name, tuple(classes[i] for i in present), of_class.astype(np.int64)))
    return tuple(parts)


def _parts(task_target: Target) -> tuple[str | Column, ...]:
    parts = task_target if isinstance(task_target, tuple) else (task_target,)
    if not parts:
        raise RecordingError("task.target must be a column, got none")
    return parts


def _values(columns: Mapping[str, Array], part: str | Column) -> Array:
    name = part.column if isinstance(part, Column) else part
    if name not in columns:
        raise RecordingError(
            f"task.target: no column '{name}' among data.columns; {known_names(name, columns)}"
        )
    values = columns[name]
    if isinstance(part, Column) and part.abs:
        if values.dtype.kind not in "iuf":
            raise RecordingError(f"task.target: abs needs numbers, but column '{name}' holds {values.dtype}")
        return np.asarray(np.abs(values if values.dtype.kind == "f" else values.astype(np.int64)))
    return values


def _text(value: object) -> str:
    return str(value).removesuffix(".0") if isinstance(value, np.floating) else str(value)


def in_use(codes: Ints, classes: tuple[str, ...], used: Bools) -> tuple[Ints, tuple[str, ...]]:
    """Return (n,) codes and classes, of the classes alone that recordings in use have; others are -1."""
    codes_in_use = np.unique(codes[used])
    new = np.full(len(classes), -1, dtype=np.int64)
    new[codes_in_use] = np.arange(len(codes_in_use))
    return new[codes], tuple(classes[i] for i in codes_in_use)
