"""Names of prepared data: hashes of what they follow from, not of where it lies."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from dse.base.records import Bools, Ints
from dse.config.contracts import PLACES
from dse.config.resolved import Sections
from dse.config.yaml_lines import Raw

# Raised when the same sections and recordings give another data set than before.
_VERSION = 2
_OF_SPIKES = ("window", "preprocessing", "encoder")
_LABELS = ("columns", "class_names")
# Keys that were added later, with the value that leaves data sets as they were before: it is not hashed, so
# that these data sets keep their names.
_ADDED: Mapping[str, Mapping[str, Raw]] = {
    "window": {"pad": False},
    "preprocessing": {"every_event": False},
    "encoder": {"full_scale": None},
    "data": {"axes": None, "time": None, "time_unit": None, "resample": None},
}


def dataset_key(design: Sections, base: Path, only: Ints | None = None) -> str:
    """Return a hash of all that a data set follows from: the sections, and what the recordings hold.

    Where the recordings lie and what their files are called does not matter. only: recordings that it is
    limited to; None: all of the split.

    Raises:
        RecordingError: a file is not found.
    """
    sections = widened(design).to_plain()
    parts = {name: _hashed(name, sections) for name in ("split", *_OF_SPIKES)}
    task = sections["task"]
    evaluated: list[Raw] = []
    if design.evaluation is not None:
        # Not a list: data sets of such names may lack the spikes of who is left out.
        out = design.left_out and {design.left_out.column: design.left_out.values}
        evaluated = [sections["evaluation"], design.window.jitter_steps, out]
    if only is not None:
        evaluated.append({"only": only.tolist()})
    return _hash([_VERSION, task["target"], task["joint"], parts | sources(design, base), *evaluated])


def widened(design: Sections) -> Sections:
    """Return a design whose windows have room for the shifts of its evaluation."""
    if design.evaluation is None or design.evaluation.reach <= design.window.jitter_steps:
        return design
    window = dataclasses.replace(design.window, jitter_steps=design.evaluation.reach)
    return dataclasses.replace(design, window=window)


def spikes_key(design: Sections, base: Path, used: Sequence[Bools]) -> str:
    """Return a hash of all that the spikes of a data set follow from: no label, no target, no split.

    Nothing in the design is left to be fitted. used: which recordings of the data, and of the test file if
    there is one, have spikes.
    """
    sections = design.to_plain()
    parts = {name: _hashed(name, sections) for name in _OF_SPIKES}
    for name, keys in sources(design, base).items():
        parts[name] = {key: value for key, value in keys.items() if key not in _LABELS}
    return _hash([_VERSION, "spikes", parts, [mask.astype(int).tolist() for mask in used]])


def same_spikes(design: Sections) -> str:
    """Return a text that designs share if most of the work on their spikes may well be the same.

    Then one waits for the other. An encoder's part is small where events have to be pooled first.
    """
    sections = widened(design).to_plain()
    names = [name for name in _OF_SPIKES if name != "encoder" or design.preprocessing is None]
    return json.dumps([sections.get(name) for name in ("data", "test", *names)], sort_keys=True, default=str)


def sources(design: Sections, base: Path) -> dict[str, dict[str, Raw]]:
    """Return the keys of `data` and `test`, with a hash of what they name in place of where it is."""
    sections = design.to_plain()
    keys: dict[str, dict[str, Raw]] = {"data": {}, "test": {}}
    for name, source in (("data", design.data), ("test", design.test)):
        if source is not None:
            settings = _hashed("data", {"data": sections[name]})
            keys[name] = {k: x for k, x in settings.items() if k not in PLACES} | {
                "file": source.content(base)
            }
    return keys


def _hashed(name: str, sections: Mapping[str, dict[str, Raw]]) -> dict[str, Raw]:
    """Return the keys of a section that a data set's name follows from."""
    added = _ADDED.get(name, {})
    return {k: v for k, v in sections.get(name, {}).items() if k not in added or v != added[k]}


def _hash(parts: Raw) -> str:
    return hashlib.sha256(json.dumps(parts, sort_keys=True, default=str).encode()).hexdigest()
