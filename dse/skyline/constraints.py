"""Conditions on the rows of a table, as text: "energy_uj <= 50 and task == 'texture'".

    EXPR  = EXPR and EXPR | EXPR or EXPR | not EXPR | ( EXPR ) | TEST
    TEST  = VALUE (== | != | < | <= | > | >=) VALUE ... | VALUE [not] in [constant, ...] | column of booleans
    VALUE = a column name, dots allowed (model.hidden) | number | 'text' | True | False

Python's parser reads the text and this file walks the tree; nothing is evaluated as code. Any comparison with
a missing value (NaN) is false, as in SQL.
"""

from __future__ import annotations

import ast
import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from dse.base import registry
from dse.base.records import Array, Bools, Floats
from dse.config.expressions import (
    OPERATORS,
    ExpressionError,
    Truth,
    column_name,
    conjuncts,
    constant,
    evaluate,
    named_columns,
    parse,
)
from dse.config.faults import did_you_mean

__all__ = ["Budget", "ExpressionError", "column", "matches", "named_columns", "split_budgets"]

_MIRRORED = {"<=": ">=", ">=": "<=", "<": ">", ">": "<", "==": "=="}


@dataclass(frozen=True)
class Budget:
    """One comparison of a column with a number."""

    column: str
    operator: str
    limit: float

    def __str__(self) -> str:
        return f"{self.column}{self.operator}{self.limit:g}"

    @property
    def direction(self) -> str:
        """The direction in which this budget is easier to meet: 'min', 'max', or '' for ==."""
        return {"<": "min", ">": "max"}.get(self.operator[0], "")

    def met(self, values: Floats) -> Bools:
        """Return which values are within the limit."""
        compare = next(function for sign, function in OPERATORS.values() if sign == self.operator)
        return np.asarray(compare(values, self.limit), dtype=bool)

    def excess(self, values: Floats) -> Floats:
        """Return the amount by which each value misses the limit, in the column's unit; 0 at the limit."""
        over = {"min": values - self.limit, "max": self.limit - values}
        return np.asarray(np.maximum(over.get(self.direction, np.abs(values - self.limit)), 0.0))


def matches(expression: str, frame: pd.DataFrame) -> Bools:
    """Return which rows of a table satisfy a condition.

    Raises:
        ExpressionError: the text is no condition, names no column, or compares text with numbers.
    """
    operand = functools.cache(functools.partial(_operand, frame=frame, text=expression))

    def compare(left: ast.expr, sign: ast.cmpop, right: ast.expr) -> Truth:
        met = _test(OPERATORS[type(sign)][1], operand(left), operand(right), expression)
        return Truth(met, ~met)

    def is_boolean(name: str) -> bool:
        return name in frame.columns and pd.api.types.is_bool_dtype(frame[name].dtype)

    return np.array(np.broadcast_to(evaluate(expression, compare, is_boolean).may, len(frame)))


def split_budgets(expressions: Sequence[str]) -> tuple[list[Budget], list[str]]:
    """Split conditions at their 'and': numeric limits of one column, and everything else.

    "energy_uj <= 50 and task == 'texture'" gives one budget and one condition that is never relaxed.

    Raises:
        ExpressionError: the text is no condition.
    """
    budgets: list[Budget] = []
    rest: list[str] = []
    for expression in expressions:
        for part in conjuncts(parse(expression)):
            budget = _budget(part)
            if budget is None:
                rest.append(ast.unparse(part))
            elif budget not in budgets:
                budgets.append(budget)
    return budgets, rest


def conditions_of(expressions: Sequence[str]) -> list[str]:
    """Split conditions at their 'and'.

    Raises:
        ExpressionError: the text is no condition.
    """
    return [ast.unparse(part) for expression in expressions for part in conjuncts(parse(expression))]


def column(frame: pd.DataFrame, name: str) -> pd.Series[Any]:
    """Return a column.

    Raises:
        ExpressionError: there is none of that name.
    """
    if name not in frame.columns:
        if name in registry.columns("hardware"):
            raise ExpressionError(
                f"column '{name}' needs costs, which these points do not have: add --hardware NAME "
                "(`dse describe hardware`), in Python hardware='NAME'"
            )
        names = list(map(str, frame.columns))
        known = f"known: {', '.join(names)}"
        near = did_you_mean(name, names)  # first, since tables have many columns
        raise ExpressionError(f"unknown column '{name}'{f'. {near} K{known[1:]}' if near else f'; {known}'}")
    return frame[name]


def _budget(node: ast.expr) -> Budget | None:
    if not isinstance(node, ast.Compare) or len(node.ops) != 1 or type(node.ops[0]) not in OPERATORS:
        return None
    sign = OPERATORS[type(node.ops[0])][0]
    left, right = node.left, node.comparators[0]
    if sign not in _MIRRORED:
        return None
    if column_name(left) is None:
        left, right, sign = right, left, _MIRRORED[sign]
    name, limit = column_name(left), constant(right)
    if name is None or isinstance(limit, bool) or not isinstance(limit, int | float):
        return None
    return Budget(name, sign, float(limit))


@dataclass(frozen=True)
class _Operand:
    """One side of a comparison, over all rows; `is_text` is None if no row has a value."""

    values: Array
    present: Bools
    is_text: bool | None


def _test(compare: Callable[[Array, Array], Bools], left: _Operand, right: _Operand, text: str) -> Bools:
    if None not in (left.is_text, right.is_text) and left.is_text != right.is_text:
        raise ExpressionError(f"condition '{text}' compares text with a number")
    result = left.present & right.present
    result[result] = compare(left.values[result], right.values[result])
    return result


def _operand(node: ast.expr, frame: pd.DataFrame, text: str) -> _Operand:
    name = column_name(node)
    if name is None:
        written = constant(node)
        if written is None:
            raise ExpressionError(
                f"condition '{text}': '{ast.unparse(node)}' must be a column, a number, 'text', True or False"
            )
        is_text = isinstance(written, str)
        values = np.full(len(frame), written, dtype=object if is_text else np.float64)
        return _Operand(values, np.ones(len(frame), dtype=bool), is_text)
    series = column(frame, name)
    present = series.notna().to_numpy(dtype=bool)
    if pd.api.types.is_numeric_dtype(series.dtype):
        return _Operand(series.to_numpy(dtype=np.float64, na_value=np.nan), present, False)
    values = series.to_numpy(dtype=object)
    kinds = {isinstance(x, str) if isinstance(x, str | bool | int | float) else None for x in values[present]}
    if None in kinds or len(kinds) > 1:
        raise ExpressionError(
            f"condition '{text}': column '{name}' must hold either text or numbers in every row"
        )
    return _Operand(values, present, kinds.pop() if kinds else None)
