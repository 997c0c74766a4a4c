"""Designs that a user wants trained next: a folder of files that a running search reads at each batch."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

from dse import seeds, store
from dse.config import Fault, SearchSpace
from dse.config.faults import known_names
from dse.config.space import Design
from dse.config.values import echo
from dse.config.yaml_lines import Document, in_file_order, read_document
from dse.study.warm import axis_value, on_axes

_FOLDER = "queue"


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


def add(folder: Path, designs: Sequence[Design]) -> None:
    """Append designs to the queue of a study's folder; a design that waits already keeps its place.

    Raises:
        StoreError: the folder cannot be written.
    """
    queue = folder / _FOLDER
    with store.explained(queue):
        queue.mkdir(parents=True, exist_ok=True)
        waiting = {path.stem.split("_", 1)[1]: path for path in _files(folder)}
        number = 1 + max((int(path.stem.split("_", 1)[0]) for path in waiting.values()), default=0)
    for place, design in enumerate(designs):
        name = hashlib.sha256(seeds.design_key(design).encode()).hexdigest()[:16]
        if name not in waiting:
            store.write_sealed_json(queue / f"{number + place:06d}_{name}.json", {"design": dict(design)})


def waiting(space: SearchSpace, folder: Path) -> list[tuple[Path, Design | None]]:
    """Return the files of the queue and their designs, in order; None of one that is none of the space."""
    read = []
    for path in _files(folder):
        try:
            design = on_axes(space, store.read_json(path, needs_seal=False)["design"])
        except (store.StoreError, LookupError, TypeError, AttributeError):
            design = None
        read.append((path, design))
    return read


def _files(folder: Path) -> list[Path]:
    return sorted(path for path in (folder / _FOLDER).glob("*_*.json") if path.stem.split("_")[0].isdigit())
