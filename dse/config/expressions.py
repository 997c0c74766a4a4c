"""Conditions as text, such as "energy_uj <= 50 and task == 'texture'": read, not evaluated.

`dse.skyline.constraints` states the grammar and evaluates conditions on tables, `dse.search.limits` on what
is known of a design before it is trained.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Collection, Iterable, Iterator, Mapping

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


def condition_faults(
    node: ast.expr, where: str, is_text: Mapping[str, bool], booleans: Collection[str]
) -> list[str]:
    """Return what keeps a tree from being a condition on some columns, a sentence each.

    Args:
        node: the tree.
        where: begins every sentence.
        is_text: column -> whether it holds text; columns that are missing hold numbers.
        booleans: columns that are conditions by themselves.
    """
    if isinstance(node, ast.BoolOp):
        return [fault for part in node.values for fault in condition_faults(part, where, is_text, booleans)]
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        return condition_faults(node.operand, where, is_text, booleans)
    if not isinstance(node, ast.Compare):
        is_boolean = column_name(node) in booleans
        return [] if is_boolean else [f"{where}: '{ast.unparse(node)}' is not a comparison"]
    faults = []
    left = node.left
    for sign, right in zip(node.ops, node.comparators, strict=True):
        is_listed = isinstance(sign, ast.In | ast.NotIn)
        if isinstance(sign, ast.Is | ast.IsNot):
            faults.append(f"{where} may only use ==, !=, <, <=, >, >= and in")
        elif is_listed and not isinstance(right, ast.List | ast.Tuple | ast.Set):
            faults.append(f"{where}: 'in' must be followed by a list such as [1, 2]")
        else:
            others = (
                right.elts if isinstance(right, ast.List | ast.Tuple | ast.Set) and is_listed else [right]
            )
            faults += _operand_faults(left, others, where, is_text)
        left = right
    return faults


def _operand_faults(
    left: ast.expr, others: Iterable[ast.expr], where: str, is_text: Mapping[str, bool]
) -> list[str]:
    kinds = []
    for node in (left, *others):
        name, value = column_name(node), constant(node)
        if name is None and value is None:
            return [f"{where}: '{ast.unparse(node)}' must be a column, a number, 'text', True or False"]
        kinds.append(is_text.get(name, False) if name is not None else isinstance(value, str))
    return [f"{where} compares text with a number"] if len(set(kinds)) > 1 else []
