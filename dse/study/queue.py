"""The queue of a study: designs that a user wants trained. A running search reads it at each batch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from dse.base.seeds import design_key
from dse.config import SearchSpace
from dse.config.axes import Axis
from dse.config.faults import known_names
from dse.config.space import Design
from dse.config.values import echo, plain
from dse.config.yaml_lines import Document, Raw, read_document
from dse.store import Book, back_up, explained


def on_axes(space: SearchSpace, design: Mapping[str, object]) -> dict[str, Raw] | None:
    """Return a design with the values of a space's axes; None if it is none of the space."""
    known: dict[str, Raw] = {}
    for name, written in design.items():
        axis = space.axes.get(name)
        value = None if axis is None else axis_value(axis, written)
        if value is None:
            return None
        known[name] = value[0]
    return known if set(known) == set(space.active(known)) else None


def axis_value(axis: Axis, written: object) -> tuple[Raw] | None:
    """Return the value of an axis that equals a written one, alone in a tuple; None if it is not on the axis.

    A whole number is on an axis of reals too.
    """
    value = plain(written)
    if axis.values is not None:
        if axis.is_list and isinstance(value, tuple) and len(value) == 1 and value not in axis.values:
            value = value[0]  # a list of one may stand as its element
        same = [x for x in axis.values if x == value and isinstance(x, bool) == isinstance(value, bool)]
        return (same[0],) if same else None
    if not axis.is_int and type(value) is int:
        value = float(value)
    return (value,) if axis.contains(value) else None


def read_designs(space: SearchSpace, path: Path) -> list[Design]:
    """Return the designs of a YAML file: a mapping of axes to values, or a list of these.

    Raises:
        ConfigError: every design that is none of the search space, with its line.
    """
    document = read_document(path, {})
    document.check()
    written = document.data if isinstance(document.data, list) else [document.data]
    designs: list[Design] = []
    for index, one in enumerate(written):
        where = (index,) if isinstance(document.data, list) else ()
        design = on_axes(space, one) if isinstance(one, dict) else None
        if design is not None:
            designs.append(design)
        else:
            _report(space, one, document, where)
    if not written:
        document.report((), "must hold at least one design, got none")
    document.check()
    return designs


def _report(space: SearchSpace, one: object, document: Document, where: tuple[int, ...]) -> None:
    """Report why something is no design of a search space."""
    if not isinstance(one, dict):
        document.report(where, f"a design must be a mapping of axes to values, got {echo(one)}")
        return
    n_before = len(document.faults)
    for name, value in one.items():
        axis = space.axes.get(name)
        if axis is None:
            document.report((*where, name), f"unknown axis '{name}'; {known_names(name, space.axes)}")
        elif axis_value(axis, value) is None:
            text = f"{name} must be on its axis {axis.to_plain()}, got {echo(value)}"
            document.report((*where, name), text)
    if len(document.faults) == n_before:
        needed = list(space.active(one))
        text = f"a design must have the axes {', '.join(needed)}, got {', '.join(map(str, one)) or 'none'}"
        document.report(where, text)


def enqueue(folder: Path, designs: Sequence[Design]) -> None:
    """Append designs to the queue of a study's folder; a design that waits already keeps its place.

    Raises:
        StoreError: the folder cannot be written.
    """
    with explained(folder):
        folder.mkdir(parents=True, exist_ok=True)
    with Book(folder, writes=True) as book:
        with book.together():
            rows = book.rows("queue")
            known = {design_key(row["design"]) for row in rows}
            place = 1 + max((row["place"] for row in rows), default=0)
            new = [dict(design) for design in designs if design_key(design) not in known]
            book.put("queue", [{"place": place + n, "design": design} for n, design in enumerate(new)])
        back_up(book)
