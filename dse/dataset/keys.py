"""Names under which data sets and their spikes are kept: hashes of all that they follow from."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dse.dataset.sections import Resolved, component
from dse.recordings import PLACES
from dse.records import Array

# Raised when the same sections and recordings give another data set than before.
_VERSION = 2
_OF_SPIKES = ("window", "preprocessing", "encoder")
_LABELS = ("columns", "class_names")


def dataset_key(resolved: Resolved, base: Path) -> str:
    """Return a hash of all that a data set follows from: the sections, and what the recordings hold.

    Where the recordings lie and what their files are called does not matter.

    Raises:
        RecordingError: a file is not found.
    """
    parts: dict[str, Any] = {name: dict(resolved.get(name) or {}) for name in ("split", *_OF_SPIKES)}
    parts |= sources(resolved, base)
    task = resolved["task"]
    return _hash([_VERSION, task["target"], bool(task.get("joint")), parts])


def spikes_key(resolved: Resolved, base: Path, used: Sequence[Array]) -> str:
    """Return a hash of all that the spikes of a data set follow from: no label, no target, no split.

    Args:
        resolved: sections, in which nothing is left to be fitted to training recordings.
        base: folder that recordings are looked up beside.
        used: which recordings of the data, and of the test file if there is one, have spikes.
    """
    parts: dict[str, Any] = {name: dict(resolved.get(name) or {}) for name in _OF_SPIKES}
    for name, keys in sources(resolved, base).items():
        parts[name] = {key: value for key, value in keys.items() if key not in _LABELS}
    return _hash([_VERSION, "spikes", parts, [mask.astype(int).tolist() for mask in used]])


def same_spikes(resolved: Resolved) -> str:
    """Return a text that designs share if most of the work on their spikes may well be the same.

    Then one waits for the other. An encoder's part is small where events have to be pooled first.
    """
    names = [name for name in _OF_SPIKES if name != "encoder" or not resolved.get("preprocessing")]
    return json.dumps([resolved.get(name) for name in ("data", "test", *names)], sort_keys=True, default=str)


def sources(resolved: Resolved, base: Path) -> dict[str, dict[str, Any]]:
    """Return the keys of `data` and `test`, with a hash of what they name in place of where it is."""
    found: dict[str, dict[str, Any]] = {"data": {}, "test": {}}
    keys: Mapping[str, Any] = {}
    for name in found:
        own = resolved.get(name) or {}
        keys = {**keys, **own}
        if own:
            content = component("recordings", keys).content(base)
            found[name] = {key: value for key, value in own.items() if key not in PLACES} | {"file": content}
    return found


def _hash(parts: Any) -> str:
    return hashlib.sha256(json.dumps(parts, sort_keys=True, default=str).encode()).hexdigest()
