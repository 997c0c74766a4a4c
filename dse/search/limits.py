"""Limits on what is known of a design before it is trained: whether it can meet them.

A column is known as a text, or as the interval in which its number will lie: one number where it is exact,
no upper end where only a lower bound is known. A design cannot meet a limit if no numbers in the intervals
do. A missing number is NaN, and any comparison with it is false, as in tables (`dse.skyline.constraints`).
"""

from __future__ import annotations

import ast
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from dse.config.expressions import OPERATORS, Truth, column_name, column_names, constant, evaluate, parse

Known = str | tuple[float, float]
"""A text, or the least and the largest number."""

Row = Mapping[str, Known]
"""Column -> what is known of it; a column that is absent may hold any number."""

ANY = (-math.inf, math.inf)
MISSING = (math.nan, math.nan)


@dataclass(frozen=True)
class Exclusion:
    """Why a design is not trained.

    reason: a sentence.
    limits: the limits that it cannot meet, each alone; empty if it meets each alone and not all together, or
        if a measured design dominates it.
    """

    reason: str
    limits: tuple[str, ...]


def can_meet(limit: str, row: Row) -> bool:
    """Return whether a design can meet a limit.

    Args:
        limit: a condition that `dse.config.names.limits` accepts.
        row: what is known of the design.
    """

    def compare(left: ast.expr, sign: ast.cmpop, right: ast.expr) -> Truth:
        return _compared(_operand(left, row), sign, _operand(right, row))

    return bool(evaluate(limit, compare, lambda _: True).may)


def exclusion(limits: Sequence[str], rows: Mapping[str, Row]) -> Exclusion | None:
    """Return why a design cannot meet all limits in any of its rows; None if it can.

    Args:
        limits: conditions.
        rows: hardware profile, '' for none -> what is known of the design there.
    """
    if any(all(can_meet(limit, row) for limit in limits) for row in rows.values()):
        return None
    missed = {chip: [limit for limit in limits if not can_meet(limit, row)] for chip, row in rows.items()}
    chip = min(missed, key=lambda name: len(missed[name]))
    reasons = [_reason(limit, rows[chip]) for limit in missed[chip]]
    where = f" on {chip}" if len(rows) > 1 else ""
    everywhere = tuple(limit for limit in limits if all(limit in of_chip for of_chip in missed.values()))
    return Exclusion(f"cannot meet {'; '.join(reasons)}{where}", everywhere)


def _reason(limit: str, row: Row) -> str:
    """Return `n_weights <= 20000: n_weights is 38880`."""
    known = [_text(name, row.get(name, ANY)) for name in dict.fromkeys(column_names(parse(limit)))]
    return f"{limit}: {', '.join(filter(None, known))}"


def _text(name: str, known: Known) -> str:
    if isinstance(known, str):
        return f"{name} is '{known}'"
    low, high = known
    if math.isnan(low):
        return f"{name} has no value"
    if low == high:
        return f"{name} is {low:.10g}"
    if math.isfinite(low):
        return f"{name} is at least {low:.4g}"
    return f"{name} is at most {high:.4g}" if math.isfinite(high) else ""


def _operand(node: ast.expr, row: Row) -> Known:
    name = column_name(node)
    if name is not None:
        return row.get(name, ANY)
    value = constant(node)
    assert value is not None  # as the reader of limits has checked
    return value if isinstance(value, str) else (float(value), float(value))


def _compared(left: Known, sign: ast.cmpop, right: Known) -> Truth:
    if isinstance(left, str) or isinstance(right, str):
        # A text that is missing is NaN, and no text.
        true = (
            isinstance(left, str) and isinstance(right, str) and bool(OPERATORS[type(sign)][1](left, right))
        )
        return Truth(true, not true)
    (low, high), (other_low, other_high) = left, right
    if math.isnan(low) or math.isnan(other_low):
        return Truth(may=False, may_not=True)
    overlap = low <= other_high and other_low <= high
    same = low == high == other_low == other_high
    if isinstance(sign, ast.Eq):
        return Truth(overlap, not same)
    if isinstance(sign, ast.NotEq):
        return Truth(not same, overlap)
    if isinstance(sign, ast.Gt | ast.GtE):
        (low, high), (other_low, other_high) = right, left
    if isinstance(sign, ast.Lt | ast.Gt):
        return Truth(low < other_high, high >= other_low)
    return Truth(low <= other_high, high > other_low)
