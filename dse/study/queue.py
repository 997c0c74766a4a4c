"""The queue of a study: designs that a user wants trained. A running search reads it at each batch."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from dse.config import Fault, SearchSpace
from dse.config.faults import known_names
from dse.config.space import Design
from dse.config.values import echo
from dse.config.yaml_lines import Document, in_file_order, read_document
from dse.seeds import design_key
from dse.store import Book, back_up, explained
from dse.study.warm import axis_value, on_axes


def read_designs(space: SearchSpace, path: Path) -> list[Design]:
    """Return the designs of a YAML file: a mapping of axes to values, or a list of these.

    Raises:
        ConfigError: every design that is none of the search space, with its line.
    """
    document = read_document(path, {})
    if document.faults:
        raise in_file_order(document.faults)
    written = document.data if isinstance(document.data, list) else [document.data]
    designs: list[Design] = []
    faults: list[Fault] = []
    for index, one in enumerate(written):
        where = (index,) if isinstance(document.data, list) else ()
        design = on_axes(space, one) if isinstance(one, dict) else None
        if design is not None:
            designs.append(design)
        else:
            faults += _faults(space, one, document, where)
    if not written:
        faults.append(document.fault((), "must hold at least one design, got none"))
    if faults:
        raise in_file_order(faults)
    return designs


def _faults(space: SearchSpace, one: object, document: Document, where: tuple[int, ...]) -> list[Fault]:
    if not isinstance(one, dict):
        return [document.fault(where, f"a design must be a mapping of axes to values, got {echo(one)}")]
    faults = []
    for name, value in one.items():
        axis = space.axes.get(name)
        if axis is None:
            text = f"unknown axis '{name}'; {known_names(name, space.axes)}"
            faults.append(document.fault((*where, name), text))
        elif axis_value(axis, value) is None:
            text = f"{name} must be on its axis {axis.to_plain()}, got {echo(value)}"
            faults.append(document.fault((*where, name), text))
    if not faults:
        needed = list(space.active(one))
        text = f"a design must have the axes {', '.join(needed)}, got {', '.join(map(str, one)) or 'none'}"
        faults.append(document.fault(where, text))
    return faults


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
