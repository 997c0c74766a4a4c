"""A resolved design -> Dataset: read recordings, place windows, split, turn into spikes."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Generator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dse import cache
from dse.dataset.files import joined, load, read_meta, read_spikes, write_dataset, write_spikes
from dse.dataset.keys import dataset_key, spikes_key
from dse.dataset.parts import Part, Result, Telling, count, fitted, placed
from dse.dataset.sections import Resolved, component, section
from dse.recordings import RecordingError, Recordings, Source, leakage
from dse.recordings.splits import Split, split
from dse.recordings.targets import target, target_columns
from dse.records import Array, Dataset


def prepare(resolved: Resolved, base: Path, root: Path, threads: int = 1) -> Telling[cache.Hold]:
    """Return a hold of the data set of a design in a cache, which is made if it is not there.

    Sample i is recording i of the data; recordings of a `test` file follow. Recordings in no part of the
    split have no spikes. The classes are those of the recordings in use; the target of others is -1.
    Designs that differ in labels alone share their spikes.

    Args:
        resolved: sections data, task, split and, where needed, window, preprocessing, encoder, test.
        base: folder that recordings are looked up beside.
        root: of the cache.
        threads: for trials that are simulated; the result is the same with any number.

    Raises:
        RecordingError: anything wrong with the recordings or with what is asked of them.
        OSError: the cache cannot be written.
    """
    key = dataset_key(resolved, base)
    return (yield from cache.made(root, key, lambda folder: _filled(folder, resolved, base, root, threads)))


def _filled(
    folder: Path, resolved: Resolved, base: Path, root: Path, threads: int
) -> Generator[str, None, None]:
    """Write a data set to a folder of the cache, after its spikes."""
    recordings = _read(resolved["data"], base)
    settings = resolved["task"]["target"]
    rule = section(Split, resolved["split"])
    leakage.guard(target_columns(settings), rule.columns())
    codes, classes = target(recordings.columns, settings)
    train, validation, test = split(recordings.columns, codes, classes, rule)
    used = np.zeros(len(codes), dtype=bool)
    used[np.concatenate([train, validation, test])] = True
    codes, classes = _in_use(codes, classes, used)
    design = yield from fitted(recordings, resolved, train)
    sources, targets = [(recordings, used)], [codes]
    if resolved.get("test"):
        if len(test):
            raise RecordingError(
                "test recordings must come from split.test or from the test file, not from both"
            )
        other = _read({**resolved["data"], **resolved["test"]}, base)
        sources.append((other, np.ones(count(other), dtype=bool)))
        targets.append(_codes_of(other, settings, classes, "the test file"))
        test = len(codes) + np.arange(len(targets[1]))

    def fill(place: Path) -> Generator[str, None, None]:
        parts = []
        for recorded, mask in sources:
            parts.append((yield from placed(recorded, design, mask, threads)))
        _check_alike(parts)
        yield from write_spikes(parts, place, threads)

    name = spikes_key(design, base, [mask for _, mask in sources])
    with (yield from cache.made(root, name, fill)) as spikes:
        stored = read_spikes(spikes.folder)
    what = " and ".join(target_columns(settings))
    traps = leakage.warnings(stored.lengths, stored.levels, targets[0], train, validation, what)
    notes = [*stored.notes, *traps]
    crop = None if design == dict(resolved) else design["preprocessing"]["crop"]
    write_dataset(folder, name, np.concatenate(targets), classes, (train, validation, test), crop, notes)


def hold(root: Path, key: str) -> contextlib.ExitStack | None:
    """Return a hold of a data set and of its spikes, or None where it has to be prepared.

    Raises:
        OSError: the cache cannot be written.
    """
    with contextlib.ExitStack() as held:
        found = cache.hold(root, key)
        if found is None:
            return None
        held.enter_context(found)
        spikes = None
        try:
            spikes = read_meta(found.folder)["spikes"]
            beside = cache.hold(root, spikes)
            if beside is not None:
                held.enter_context(beside)
                load(found.folder)
                return held.pop_all()
        except RecordingError:  # whatever is wrong with a cache, making it again is right
            if spikes is not None:
                cache.discard(root, spikes)
        cache.discard(root, key)
    return None


def warnings(folder: Path) -> list[str]:
    """Return what is suspicious about the recordings of a prepared data set."""
    return list(read_meta(folder)["warnings"])


def as_prepared(resolved: Resolved, folder: Path) -> dict[str, Any]:
    """Return a design with what its prepared data set has fitted to the recordings in place of how."""
    crop = read_meta(folder)["crop"]
    if crop is None:
        return dict(resolved)
    return {**resolved, "preprocessing": {**resolved["preprocessing"], "crop": crop}}


def build(resolved: Resolved, base: Path, threads: int = 1) -> tuple[Dataset, list[str]]:
    """Return the data set of a design, kept nowhere, and what is suspicious about its recordings.

    Raises:
        RecordingError: as for `prepare`.
    """
    with tempfile.TemporaryDirectory() as folder:
        with _result(prepare(resolved, base, Path(folder), threads)) as found:
            return load(found.folder), warnings(found.folder)  # what is mapped stays when its file is gone


def build_for(resolved: Resolved, base: Path, classes: Sequence[str]) -> tuple[Dataset, list[str]]:
    """Return a data set of new recordings, all of them in `test`, and what had to be repaired in them.

    They are prepared as `prepare` would.

    Args:
        resolved: as for `prepare`, with section `data` naming the new file; split and test are not read.
        base: folder that the file is looked up beside.
        classes: those of the data that was trained on.

    Raises:
        RecordingError: anything wrong with the recordings, or labels that are none of the classes. A file
            that lacks a column of the target is no fault: its targets are -1.
    """
    source: Source = component("recordings", resolved["data"])
    recordings = source.with_columns_found(base).read(base)
    n = count(recordings)
    settings = resolved["task"]["target"]
    codes = np.full(n, -1, dtype=np.int64)
    if set(target_columns(settings)) <= set(recordings.columns):
        codes = _codes_of(recordings, settings, tuple(classes), "the new recordings")
    with tempfile.TemporaryDirectory() as folder:
        part = _result(placed(recordings, resolved, np.ones(n, dtype=bool)))
        _result(write_spikes([part], Path(folder)))
        found = read_spikes(Path(folder))
    none = np.zeros(0, dtype=np.int64)
    return joined(found, tuple(classes), codes, none, none, np.arange(n)), found.notes


def _result(telling: Telling[Result]) -> Result:
    """Return what a generator returns at its end."""
    while True:
        try:
            next(telling)
        except StopIteration as end:
            result: Result = end.value
            return result


def _read(keys: Any, base: Path) -> Recordings:
    source: Source = component("recordings", keys)
    return source.read(base)


def _check_alike(parts: Sequence[Part]) -> None:
    for other in parts[1:]:
        for name, a, b in (
            ("channels", parts[0].n_channels, other.n_channels),
            ("ms per step", parts[0].step_ms, other.step_ms),
            ("steps per window", parts[0].n_steps, other.n_steps),
        ):
            if a != b:
                raise RecordingError(f"the test file must have {a} {name} as the data file has, got {b}")


def _in_use(codes: Array, classes: tuple[str, ...], used: Array) -> tuple[Array, tuple[str, ...]]:
    kept = np.unique(codes[used])
    new = np.full(len(classes), -1, dtype=np.int64)
    new[kept] = np.arange(len(kept))
    return new[codes], tuple(classes[i] for i in kept)


def _codes_of(recordings: Recordings, settings: Any, classes: tuple[str, ...], where: str) -> Array:
    codes, names = target(recordings.columns, settings)
    for name in names:
        if name not in classes:
            raise RecordingError(f"{where}: class '{name}' is unknown; the classes are {', '.join(classes)}")
    index = np.array([classes.index(name) for name in names], dtype=np.int64)
    return np.asarray(index[codes])
