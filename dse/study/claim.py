"""The claim of a study folder: it belongs to the search space that it was started with."""

from __future__ import annotations

import math
from collections.abc import Mapping
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


def join(space: SearchSpace, folder: Path) -> None:
    """Check that another coordinator works on the same search space in a folder, but for section `execution`.

    Raises:
        ConfigError: it does not, or designs race.
    """
    texts = [
        f"{key} is {new!r}, but {old!r} in the study that runs in {folder}"
        for key, old, new in changes(plain_space(folder / store.SPACE), yaml.safe_load(space.to_yaml()))
        if (not key.startswith("execution.") or key == "execution.device") and key not in _PLACES
    ]
    if space.search.racing is not None:
        texts.append(f"search.racing: {folder} runs, and its designs race against all others of one process")
    if texts:
        raise ConfigError([Fault(str(space.source), 0, text) for text in texts])


def claim(space: SearchSpace, book: store.Book) -> list[str]:
    """Write the search space, its plugins and the session to the folder, or check that they are the same.

    Some keys change no result and may differ: the folder of the recordings, the number of processes, more
    trials, other precisions of trained networks, targets, limits, when a search stops, and hardware after
    the first. The device may not: another one rounds differently. Until a run has finished or a design was
    asked for, any search space may replace the one before.

    A damaged copy of the search space is written anew if the finished runs were trained as this one says.

    Returns:
        What was damaged and is written anew, a sentence each.

    Raises:
        ConfigError: the folder was started with another search space; one fault per key or plugin.
    """
    folder, notes = book.folder, []
    path = folder / store.SPACE
    now = yaml.safe_load(space.to_yaml())
    files = [Path(plugin.source) for plugin in space.plugins if plugin.source.endswith(".py")]
    copies = {file: folder / "plugins" / f"{number}_{file.name}" for number, file in enumerate(files)}
    if not store.runs_in(folder) and not any(row["enqueued"] for row in book.rows("trial")):
        book.drop("trial")
        if not _trains_the_same(path, now, copies):
            store.remove(folder / "checkpoints")
            book.drop("study", "name GLOB 'racing/*'")
    else:
        before = now
        try:
            before = plain_space(path)
        except store.Damaged as error:
            _check_runs(space, folder)
            notes.append(f"{error}; it is written anew: the finished runs fit this search space")
        faults = [
            Fault(str(space.source), 0, f"{key} is {new!r}, but {folder} was started with {old!r}; {_HINT}")
            for key, old, new in changes(before, now)
            if (not key.startswith("execution.") or key == "execution.device")
            and key not in _PLACES
            and not (key == "search.n_trials" and _count(new) >= _count(old))
            and not (key == "hardware" and old[:1] == new[:1])
            and not key.startswith("precision")
            and key not in ("targets", "limits")
            and not key.startswith("search.stop")
            and not (key == "search.batch" and space.search.sampler_name == "grid")
        ]
        faults += [
            Fault(str(file), 0, f"differs from {copy}, which {folder} was started with; {_HINT}")
            for file, copy in copies.items()
            if copy.is_file() and (was := _copied(copy, notes)) is not None and was != _text(file)
        ]
        if faults:
            raise ConfigError(faults)
    environment.begin(book)
    store.write_text(path, space.to_yaml())
    for file, copy in copies.items():
        store.write_text(copy, _text(file))
    return notes


def _trains_the_same(path: Path, now: Any, copies: Mapping[Path, Path]) -> bool:
    """Return whether trainings that a folder has begun may go on."""
    try:
        differing = changes(plain_space(path), now)
        same = all(copy.is_file() and store.read_text(copy) == _text(x) for x, copy in copies.items())
    except store.StoreError:
        return False
    return same and all(x.startswith("execution.") and x != "execution.device" for x, *_ in differing)


def _text(file: Path) -> str:
    return file.read_text(encoding="utf-8", errors="replace")


def _copied(copy: Path, notes: list[str]) -> str | None:
    """Return the copy of a plugin; None, with a note, if it is damaged."""
    try:
        return store.read_text(copy)
    except store.Damaged as error:
        notes.append(f"{error}; it is written anew")
        return None


def _check_runs(space: SearchSpace, folder: Path) -> None:
    """Check that the finished runs were trained as the search space says.

    Raises:
        ConfigError: one was trained otherwise.
    """
    runs = store.runs_in(folder).items()
    for run in (store.run_file(folder, trial, repeat) for trial, of in runs for repeat in of):
        try:
            record = store.read_record(run)
            trained = record.get("sections", {})
            would = store.plain(space.resolve(record["design"]).to_plain())
        except store.Damaged:
            continue
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            text = f"does not hold the design of {run}: {error}; {_HINT}"
            raise ConfigError([Fault(str(space.source), 0, text)]) from None
        differing = [
            (f"{section}.{key}", old, would[section][key])
            for section in ("task", "model", "training")
            for key, old in (trained.get(section) or {}).items()
            if key in (would.get(section) or {}) and would[section][key] != old
        ]
        differing += [] if record["seed"] == space.seed else [("seed", record["seed"], space.seed)]
        if differing:
            texts = [f"{key} is {new!r}, but {run} was trained with {old!r}" for key, old, new in differing]
            raise ConfigError([Fault(str(space.source), 0, f"{text}; {_HINT}") for text in texts])


def changes(before: Any, now: Any, name: str = "") -> list[tuple[str, Any, Any]]:
    """Return (dotted key, old, new) for every difference of two nested mappings."""
    if not (isinstance(before, dict) and isinstance(now, dict)):
        return [] if before == now else [(name, before, now)]
    keys = dict.fromkeys([*before, *now])
    return [c for k in keys for c in changes(before.get(k), now.get(k), f"{name}.{k}" if name else str(k))]


def _count(n_trials: int | None) -> float:
    return math.inf if n_trials is None else n_trials
