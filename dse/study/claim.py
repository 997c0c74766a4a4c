"""The claim of a study folder: it belongs to the search space that it was started with."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import yaml

from dse import store
from dse.config import ConfigError, Fault, SearchSpace
from dse.recordings import PLACES
from dse.study import environment
from dse.study.results import plain_space

_HINT = "change it back, or use another study name or --results folder"
# Recordings are compared by their contents, run by run (dse.study.runs), not by their paths.
_PLACES = tuple(f"{section}.{key}" for section in ("data", "test") for key in PLACES)


def claim(space: SearchSpace, folder: Path) -> None:
    """Write the search space, its plugins and the environment to the folder, or check that they are the same.

    Some keys change no result and may differ: the folder of the recordings, the number of processes, more
    trials, other precisions of trained networks, targets, and hardware after the first. The device may not:
    another one rounds differently. Until a run has finished, any search space may replace the one before.

    Raises:
        ConfigError: the folder was started with another search space; one fault per key or plugin.
    """
    path = folder / "search_space.yaml"
    now = yaml.safe_load(space.to_yaml())
    files = [Path(plugin.source) for plugin in space.plugins if plugin.source.endswith(".py")]
    copies = {file: folder / "plugins" / f"{number}_{file.name}" for number, file in enumerate(files)}
    if next(folder.glob("artefacts/*/repeat_*"), None) is None:
        store.remove(folder / "journal.log")
    elif path.exists():
        faults = [
            Fault(str(space.source), 0, f"{key} is {new!r}, but {folder} was started with {old!r}; {_HINT}")
            for key, old, new in _changes(plain_space(path), now)
            if (not key.startswith("execution.") or key == "execution.device")
            and key not in _PLACES
            and not (key == "search.n_trials" and _count(new) >= _count(old))
            and not (key == "hardware" and old[:1] == new[:1])
            and not key.startswith("precision")
            and key != "targets"
        ]
        faults += [
            Fault(str(file), 0, f"differs from {copy}, which {folder} was started with; {_HINT}")
            for file, copy in copies.items()
            if copy.is_file() and copy.read_bytes() != file.read_bytes()
        ]
        if faults:
            raise ConfigError(faults)
    store.write_text(path, space.to_yaml())
    for file, copy in copies.items():
        with store.published(copy) as temporary:
            temporary.write_bytes(file.read_bytes())
    sessions = store.read_json(folder / "environment.json") if (folder / "environment.json").exists() else []
    store.write_json(folder / "environment.json", [*sessions, environment.describe()])


def _changes(before: Any, now: Any, name: str = "") -> list[tuple[str, Any, Any]]:
    """Return (dotted key, old, new) for every difference of two nested mappings."""
    if not (isinstance(before, dict) and isinstance(now, dict)):
        return [] if before == now else [(name, before, now)]
    keys = dict.fromkeys([*before, *now])
    return [c for k in keys for c in _changes(before.get(k), now.get(k), f"{name}.{k}" if name else str(k))]


def _count(n_trials: int | None) -> float:
    return math.inf if n_trials is None else n_trials
