"""The contract of an objective."""

from __future__ import annotations

from typing import Any, get_args

import numpy as np

from dse.base.registry import Column
from dse.measure.objectives import Needs, Objective, Points, Priced
from dse.testing.expect import expect, expect_component, pure
from dse.testing.small import records

UNITS = {
    "ms": "_ms",
    "uJ": "_uj",
    "mJ": "_mj",
    "mW": "_mw",
    "W": "_w",
    "Hz": "_hz",
    "s": "_s",
    "bit": "_bits",
    "bit/s": "_per_s",
    "bytes": "_bytes",
}
"""Unit -> what a column's name contains."""


def check_objective(objective: Objective[Any]) -> None:
    """Check an objective: declared columns, plain numbers, no side effects.

    Raises:
        AssertionError: what it violates.
    """
    name = expect_component(objective)
    expect(objective.needs in get_args(Needs), f"{name}.needs must be one of {', '.join(get_args(Needs))}")
    expect(objective.columns, f"{name}.columns must declare one or more columns")
    for column in objective.columns:
        _check_column(name, column)
    declared = {column.name for column in objective.columns}
    for record in records()[objective.needs]:
        columns = pure(f"{name}.measure", objective.measure, record)
        unknown = sorted(set(columns) - declared)
        expect(not unknown, f"{name} must declare every column that it returns, got {', '.join(unknown)}")
        for key, value in columns.items():
            _check_value(name, key, value, _shape(record))


def _check_column(name: str, column: Column) -> None:
    expect(column.name.isidentifier(), f"{name}: column '{column.name}' must be letters, digits and '_'")
    expect(
        column.direction in ("max", "min"),
        f"{name}: direction of {column.name} must be 'max' or 'min', got '{column.direction}'",
    )
    expect(column.doc.endswith("."), f"{name}: doc of {column.name} must be a sentence")
    part = UNITS.get(column.unit, f"_{column.unit}" if column.unit else "")
    expect(part in column.name, f"{name}: the name of {column.name} must contain its unit, '{part}'")


def _check_value(name: str, column: str, value: Any, shape: tuple[int, ...] | None) -> None:
    if value is None and shape is None:
        return
    array = np.asarray(value)
    expect(
        array.dtype.kind in "biuf",
        f"{name}: {column} must be numbers, NaN where there is none, got {array.dtype}",
    )
    expect(not np.isinf(array.astype(float)).any(), f"{name}: {column} must be finite or NaN")
    if shape is None:
        expect(array.ndim == 0, f"{name}: {column} of a full read-out must be one number, got {array.shape}")
    else:
        fits = array.ndim == 0 or array.shape == shape
        expect(fits, f"{name}: {column} must have a number per point, {shape}, got {array.shape}")


def _shape(record: Any) -> tuple[int, ...] | None:
    """Return the axes of the points of a record; None for a full read-out."""
    if isinstance(record, Points):
        return np.shape(record.accuracy)
    return np.shape(record.cost.energy_uj.value) if isinstance(record, Priced) else None
