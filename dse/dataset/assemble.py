"""A resolved design -> Dataset: read recordings, place windows, split, turn into spikes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dse.dataset.parts import joined, part_of
from dse.dataset.sections import Resolved, component, section
from dse.recordings import RecordingError, Recordings, Source, leakage
from dse.recordings.splits import Split, split
from dse.recordings.targets import target, target_columns
from dse.records import Array, Dataset, Rasters


def build(resolved: Resolved, base: Path) -> tuple[Dataset, list[str]]:
    """Return the data set of a resolved design, and warnings about labels that are given away.

    Sample i is recording i of the data file; recordings of a `test` file follow. Recordings in no part of the
    split have no spikes. The classes are those of the recordings in use; the target of others is -1.

    Args:
        resolved: sections data, task, split and, where needed, window, preprocessing, encoder, test.
        base: folder that data files are looked up beside.

    Raises:
        RecordingError: anything wrong with the recordings or with what is asked of them.
    """
    source: Source = component("recordings", resolved["data"])
    recordings = source.read(base)
    settings = resolved["task"]["target"]
    rule = section(Split, resolved["split"])
    leakage.guard(target_columns(settings), rule.columns())
    codes, classes = target(recordings.columns, settings)
    train, validation, test = split(recordings.columns, codes, classes, rule)
    used = np.zeros(len(codes), dtype=bool)
    used[np.concatenate([train, validation, test])] = True
    codes, classes = _in_use(codes, classes, used)
    part, evidence = part_of(recordings, resolved, used)
    notes = leakage.warnings(*evidence, codes, train, validation, " and ".join(target_columns(settings)))
    parts, targets = [part], [codes]
    if resolved.get("test"):
        if len(test):
            raise RecordingError(
                "test recordings must come from split.test or from the test file, not from both"
            )
        extra: Source = component("recordings", {**resolved["data"], **resolved["test"]})
        other = extra.read(base)
        parts.append(part_of(other, resolved, np.ones(_count(other), dtype=bool))[0])
        targets.append(_codes_of(other, settings, classes, "the test file"))
        test = len(codes) + np.arange(len(targets[1]))
    return joined(parts, np.concatenate(targets), classes, (train, validation, test)), notes


def build_for(resolved: Resolved, base: Path, classes: Sequence[str]) -> Dataset:
    """Return a data set of new recordings, all of them in `test`, prepared as `build` would.

    Args:
        resolved: as for `build`, with section `data` naming the new file; split and test are not read.
        base: folder that the file is looked up beside.
        classes: those of the data that was trained on.

    Raises:
        RecordingError: anything wrong with the recordings, or labels that are none of the classes. A file
            that lacks a column of the target is no fault: its targets are -1.
    """
    source: Source = component("recordings", resolved["data"])
    recordings = source.with_columns_found(base).read(base)
    n = _count(recordings)
    part, _ = part_of(recordings, resolved, np.ones(n, dtype=bool))
    settings = resolved["task"]["target"]
    codes = np.full(n, -1, dtype=np.int64)
    if set(target_columns(settings)) <= set(recordings.columns):
        codes = _codes_of(recordings, settings, tuple(classes), "the new recordings")
    none = np.zeros(0, dtype=np.int64)
    return joined([part], codes, tuple(classes), (none, none, np.arange(n)))


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


def _count(recordings: Recordings) -> int:
    return recordings.spikes.n_samples if isinstance(recordings, Rasters) else recordings.n_recordings
