"""What section `evaluation` and the number of crops need of other sections, as far as a file shows it."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path as File
from typing import Any

from dse.config.faults import ConfigError, known_names
from dse.config.parts import Part
from dse.config.settings import CUT_COLUMNS, Evaluation
from dse.config.yaml_lines import Path, in_file_order, read_document

_SHIFTS, _LEAVE_OUT = ("evaluation", "shifts"), ("evaluation", "leave_out")


def evaluation_faults(sections: Mapping[str, Part]) -> Iterator[tuple[Path, str]]:
    """Yield (path, sentence) for every fault between the sections of a file.

    Args:
        sections: as they are written; those at fault are not looked into.
    """
    parts = {name: part for name, part in sections.items() if part.good}
    if "window" in parts and "training" in parts:
        if max(_values(parts["training"], "crops")) > 1 and not max(_values(parts["window"], "jitter_steps")):
            yield ("training", "crops"), "training.crops needs window.jitter_steps > 0, got 0"
    if "evaluation" not in parts:
        return
    evaluation: Evaluation = parts["evaluation"].fixed
    if evaluation.shifts is not None:
        yield from ((_SHIFTS, text) for text in _of_shifts(parts))
    if evaluation.groups:
        yield from ((_LEAVE_OUT, text) for text in _of_groups(evaluation, parts))


def evaluation_error(source: File, faults: Sequence[str]) -> ConfigError:
    """Return what recordings say against section `evaluation` of a file, with the lines of its keys.

    Args:
        source: the file.
        faults: sentences; those that begin with `evaluation.` and a key are about this key.
    """
    document = read_document(source, {})
    keys = (tuple(re.split("[ :]", text, maxsplit=1)[0].split(".")) for text in faults)
    return in_file_order(document.fault(key, text) for key, text in zip(keys, faults, strict=True))


def _of_shifts(parts: Mapping[str, Part]) -> Iterator[str]:
    if "window" in parts and None in _values(parts["window"], "n_steps"):
        yield "evaluation.shifts needs window.n_steps: a window of a whole recording has no room to move"
    if "preprocessing" in parts and any(_values(parts["preprocessing"], "rate_floor_hz")):
        yield "evaluation.shifts needs preprocessing.rate_floor_hz 0: the floor reads steps around a window"


def _of_groups(evaluation: Evaluation, parts: Mapping[str, Part]) -> Iterator[str]:
    targets = _values(parts["task"], "target") if "task" in parts else ()
    predicted = [column for target in targets for column in _columns(target)]
    known: list[str] = []
    if "data" in parts:
        known = list(parts["data"].fixed.columns)
        if "window" in parts and any(_values(parts["window"], "cut_steps")):
            known += CUT_COLUMNS
    for groups in evaluation.groups:
        name = groups.column
        if known and name not in known:
            yield f"evaluation.leave_out: no column '{name}' among data.columns; {known_names(name, known)}"
        elif name in predicted:
            yield f"evaluation.leave_out must not be the target, got '{name}', which task.target predicts"
    if "split" in parts and parts["split"].fixed.k_fold is not None:
        yield "evaluation.leave_out needs a split without k_fold, whose folds the repeats are"


def _values(part: Part, key: str) -> tuple[Any, ...]:
    """Return the values that a key has in some design; of a range, its ends."""
    axis = next((axis for axis in part.axes.values() if axis.place[1] == key), None)
    return (part.values[key],) if axis is None else axis.extremes()


def _columns(target: Any) -> tuple[str, ...]:
    """Return the columns of a target, as it is read or as an axis holds it."""
    entries = target if isinstance(target, tuple) else (target,)
    return tuple(str(x["column"] if isinstance(x, Mapping) else getattr(x, "column", x)) for x in entries)
