"""Whose a study folder is: the search space that it was started with, and no other."""

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

# What lies there counts, and is compared run by run (dse.study.runs).
_PLACES = tuple(f"{section}.{key}" for section in ("data", "test") for key in PLACES)


def claim(space: SearchSpace, folder: Path) -> None:
    """Write the search space and where it runs, or go on with the same one.

    Where recordings lie, how the work is spread, more trials, other precisions of trained networks, and
    hardware after the first change no result: they are no other search space. Another device rounds
    otherwise. Until a run has finished, nothing depends on the one before.

    Raises:
        ConfigError: the folder was started with another search space; one fault per key.
    """
    path = folder / "search_space.yaml"
    now = yaml.safe_load(space.to_yaml())
    if next(folder.glob("artefacts/*/repeat_*"), None) is None:
        store.remove(folder / "journal.log")
    elif path.exists():
        hint = "change it back, or use another study name or --results folder"
        faults = [
            Fault(str(space.source), 0, f"{key} is {new!r}, but {folder} was started with {old!r}; {hint}")
            for key, old, new in _changes(plain_space(path), now)
            if (not key.startswith("execution.") or key == "execution.device")
            and key not in _PLACES
            and not (key == "search.n_trials" and _count(new) >= _count(old))
            and not (key == "hardware" and old[:1] == new[:1])
            and not key.startswith("precision")
        ]
        if faults:
            raise ConfigError(faults)
    store.write_text(path, space.to_yaml())
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
