"""Conditions as text, such as "energy_uj <= 50 and task == 'texture'": read, not evaluated.

`dse.skyline.constraints` states the grammar and evaluates conditions on tables, `dse.search.limits` on what
is known of a design before it is trained.
"""

from __future__ import annotations

import ast
import functools
import operator
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

OPERATORS: Mapping[type[ast.cmpop], tuple[str, Callable[[Any, Any], Any]]] = {
    ast.LtE: ("<=", operator.le),
    ast.GtE: (">=", operator.ge),
    ast.Lt: ("<", operator.lt),
    ast.Gt: (">", operator.gt),
    ast.Eq: ("==", operator.eq),
    ast.NotEq: ("!=", operator.ne),
}
_TOKEN = re.compile(r"[\w.]+|[^\w\s]+")


class ExpressionError(ValueError):
    """A condition that cannot be read, or does not fit the table."""


def named_columns(expressions: Iterable[str]) -> frozenset[str]:
    """Return the columns that conditions name.

    "family != 'fits' and model.hidden > 2" names family and model.hidden: quoted text names no column, and a
    dotted name is one column.

    Raises:
        ExpressionError: a text is no condition.
    """
    return frozenset(name for expression in expressions for name in column_names(parse(expression)))


def parse(expression: str) -> ast.expr:
    """Return the tree of a condition.

    Raises:
        ExpressionError: Python's parser cannot read it.
    """
    try:
        return ast.parse(expression.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise ExpressionError(
            f"condition '{expression}' must read like \"energy_uj <= 50 and task == 'texture'\""
            f"{_place(expression.strip(), error)}"
        ) from None


def _place(text: str, error: Exception) -> str:
    """Return where a condition cannot be read, '' if that is not known."""
    if not isinstance(error, SyntaxError) or error.lineno != 1 or error.offset is None:
        return ""
    tokens = [token for token in _TOKEN.finditer(text) if error.offset and token.end() >= error.offset]
    return (
        f"; it goes wrong at '{tokens[0][0]}', character {tokens[0].start() + 1}"
        if tokens
        else "; it ends too early"
    )


def conjuncts(node: ast.expr) -> list[ast.expr]:
    """Return the parts of a condition that its outer 'and' joins; the condition itself without one."""
    if isinstance(node, ast.BoolOp) and isinstance(node.op, ast.And):
        return [part for value in node.values for part in conjuncts(value)]
    return [node]


def column_name(node: ast.AST) -> str | None:
    """Return a column name; `model.hidden` parses as an attribute of a name."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute):
        owner = column_name(node.value)
        return None if owner is None else f"{owner}.{node.attr}"
    return None


def column_names(node: ast.AST) -> Iterator[str]:
    """Yield every column name below a node, a dotted one whole."""
    name = column_name(node)
    if name is not None:
        yield name
        return
    for child in ast.iter_child_nodes(node):
        yield from column_names(child)


def constant(node: ast.expr) -> float | str | None:
    """Return a number, text, True or False that is written out; None for anything else."""
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
        value = constant(node.operand)
        if isinstance(value, int | float) and not isinstance(value, bool):
            return -value if isinstance(node.op, ast.USub) else value
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool | int | float | str):
        return node.value
    return None


class Truth(NamedTuple):
    """Whether a condition may be true, and whether it may be false: of one row, or (row,) of several."""

    may: Any
    may_not: Any


def evaluate(
    expression: str,
    compare: Callable[[ast.expr, ast.cmpop, ast.expr], Truth],
    is_boolean: Callable[[str], bool],
) -> Truth:
    """Return whether a condition may be true, and whether it may be false.

    Args:
        expression: the condition.
        compare: returns that of one comparison, with a key of `OPERATORS`.
        is_boolean: returns whether a column is a condition by itself.

    Raises:
        ExpressionError: it cannot be read.
    """

    def walk(node: ast.expr) -> Truth:
        if isinstance(node, ast.BoolOp):
            return (_all if isinstance(node.op, ast.And) else _any)(map(walk, node.values))
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            return Truth(*reversed(walk(node.operand)))
        if isinstance(node, ast.Compare):
            operands = [node.left, *node.comparators]
            return _all(map(tested, operands, node.ops, operands[1:]))
        name = column_name(node)
        if name is None or not is_boolean(name):
            raise ExpressionError(f"condition '{expression}': '{ast.unparse(node)}' is not a comparison")
        return compare(node, ast.Eq(), ast.Constant(True))

    def tested(left: ast.expr, sign: ast.cmpop, right: ast.expr) -> Truth:
        if type(sign) in OPERATORS:
            return compare(left, sign, right)
        if not isinstance(sign, ast.In | ast.NotIn):
            raise ExpressionError(f"condition '{expression}' may only use ==, !=, <, <=, >, >= and in")
        if not isinstance(right, ast.List | ast.Tuple | ast.Set):
            text = "'in' must be followed by a list such as [1, 2]"
            raise ExpressionError(f"condition '{expression}': {text}")
        is_in = _any([compare(left, ast.Eq(), item) for item in right.elts])
        if isinstance(sign, ast.In):
            return is_in
        is_there = compare(left, ast.Eq(), left).may  # what is missing equals nothing
        return _all([Truth(*reversed(is_in)), Truth(is_there, np.logical_not(is_there))])

    return walk(parse(expression))


def _all(parts: Iterable[Truth]) -> Truth:
    may, may_not = zip(*parts, strict=True)
    return Truth(functools.reduce(np.logical_and, may), functools.reduce(np.logical_or, may_not))


def _any(parts: Iterable[Truth]) -> Truth:
    none = Truth(may=False, may_not=True)
    return Truth(*reversed(_all([Truth(*reversed(part)) for part in (none, *parts)])))


def condition_fault(expression: str, is_text: Mapping[str, bool], booleans: Collection[str]) -> str:
    """Return what keeps a text from being a condition on some columns; '' if nothing does.

    Args:
        expression: the text.
        is_text: column -> whether it holds text; columns that are missing hold numbers.
        booleans: columns that are conditions by themselves.
    """

    def holds_text(node: ast.expr) -> bool:
        name, value = column_name(node), constant(node)
        if name is None and value is None:
            what = "must be a column, a number, 'text', True or False"
            raise ExpressionError(f"condition '{expression}': '{ast.unparse(node)}' {what}")
        return isinstance(value, str) if name is None else is_text.get(name, False)

    def compare(left: ast.expr, _: ast.cmpop, right: ast.expr) -> Truth:
        if holds_text(left) != holds_text(right):
            raise ExpressionError(f"condition '{expression}' compares text with a number")
        return Truth(may=True, may_not=True)

    try:
        evaluate(expression, compare, booleans.__contains__)
    except ExpressionError as error:
        return str(error).removeprefix(f"condition '{expression}'")
    return ""
