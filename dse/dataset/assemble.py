"""A resolved design -> Dataset: read recordings, place windows, split, turn into spikes."""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Generator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dse.config.settings import Split, Window
from dse.dataset import cache, encoding
from dse.dataset.files import Stored, joined, load, read_meta, read_spikes, write_dataset, write_spikes
from dse.dataset.keys import dataset_key, spikes_key
from dse.dataset.parts import Part, Result, Telling, cropped, place_signals, placed, seen_by_encoder
from dse.dataset.sections import Resolved, component, section
from dse.recordings import RecordingError, Recordings, Source, leakage
from dse.recordings.cutting import cut
from dse.recordings.splits import leak, split
from dse.recordings.targets import heads, target, target_columns
from dse.records import Array, Dataset, Signals


@dataclasses.dataclass(frozen=True)
class _Read:
    """Recordings of one file: what they are, where their channels lie, and which are in use, (n,) bool."""

    recordings: Recordings
    positions: Array | None
    used: Array


@dataclasses.dataclass(frozen=True)
class _Labels:
    """What an encoder may learn from: codes (n,) of the data's recordings, training indices into them."""

    codes: Array
    n_classes: int
    train: Array


def prepare(resolved: Resolved, base: Path, root: Path, threads: int = 1) -> Telling[Path]:
    """Return the folder of the data set of a design in a cache, which is made if it is not there.

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
    recordings, positions = _read(component("recordings", resolved["data"]), base, resolved)
    task, rule = resolved["task"], section(Split, resolved["split"])
    leakage.guard(target_columns(task["target"]), rule.columns())
    codes, classes = target(recordings.columns, task["target"])
    train, validation, test = split(recordings.columns, codes, classes, rule)
    window = section(Window, resolved.get("window"))
    reasons = [leak(recordings.columns, rule, train, validation, test, window)]
    used = np.zeros(len(codes), dtype=bool)
    used[np.concatenate([train, validation, test])] = True
    codes, classes = _in_use(codes, classes, used)
    joint = heads(recordings.columns, task["target"], codes) if task.get("joint") else ()
    design = yield from cropped(recordings, resolved, train)
    sources, targets = [_Read(recordings, positions, used)], [codes]
    if resolved.get("test"):
        if len(test):
            raise RecordingError(
                "test recordings must come either from split.test or from the test file, not from both"
            )
        other, places = _read(
            component("recordings", {**resolved["data"], **resolved["test"]}), base, resolved
        )
        sources.append(_Read(other, places, np.ones(other.n_recordings, dtype=bool)))
        targets.append(_codes_of(other, task["target"], classes, "the test file"))
        test = len(codes) + np.arange(len(targets[1]))
    labels = _Labels(codes, len(classes), train)
    name, design, spikes = yield from _spikes(sources, design, labels, base, root, threads)
    stored = read_spikes(spikes)
    seen = {head.name: head.of_class[codes] for head in joint}
    seen = seen or {" and ".join(target_columns(task["target"])): codes}
    traps = [
        trap
        for what, own in seen.items()
        for trap in leakage.warnings(stored.lengths, stored.levels, own, train, validation, what)
    ]
    if encoding.transductive(design.get("encoder")):
        reasons.append(
            f"encoder {design['encoder']['kind']} reads the labels of the recordings that it encodes"
        )
    write_dataset(
        folder, name, np.concatenate(targets), classes, (train, validation, test),
        _fitted(resolved, design), [*stored.notes, *traps], joint, "; ".join(filter(None, reasons)),
    )  # fmt: skip


def _spikes(
    sources: Sequence[_Read], design: Resolved, labels: _Labels, base: Path, root: Path, threads: int
) -> Telling[tuple[str, dict[str, Any], Path]]:
    """Return the key of the spikes, the design with its encoder fitted, and the folder of the spikes.

    Recordings of events and rasters that pass an encoder have an entry without it too: designs that differ
    in the encoder share it.
    """
    used, first = [source.used for source in sources], sources[0].recordings
    design, keys = dict(design), design.get("encoder")

    def fill(place: Path) -> Generator[str, None, None]:
        parts = []
        for source in sources:
            parts.append(
                (yield from placed(source.recordings, design, source.used, threads, source.positions))
            )
        _check_alike(parts)
        yield from write_spikes(parts, place, threads)

    if keys and isinstance(first, Signals):
        design["encoder"] = _learnt_from_signals(first, design, used[0], labels)
    if not keys or isinstance(first, Signals):
        name = spikes_key(design, base, used)
        return name, design, (yield from cache.made(root, name, fill))

    bare = spikes_key({**design, "encoder": None}, base, used)
    if encoding.learns(keys):
        stored = read_spikes((yield from cache.made(root, bare, fill)))
        design["encoder"] = encoding.learnt_from_spikes(
            keys, stored, used[0], labels.codes, labels.n_classes, labels.train
        )

    def fill_encoded(place: Path) -> Generator[str, None, None]:
        stored = read_spikes((yield from cache.made(root, bare, fill)))
        yield from write_spikes([encoding.encoded(stored, design["encoder"], np.concatenate(used))], place)

    name = spikes_key(design, base, used)
    return name, design, (yield from cache.made(root, name, fill_encoded))


def _learnt_from_signals(signals: Signals, design: Resolved, used: Array, labels: _Labels) -> dict[str, Any]:
    if not encoding.learns(design["encoder"]):
        return dict(design["encoder"])
    window = section(Window, design.get("window"))
    (start, _, _, n_steps), levels = place_signals(signals, window, used)
    return encoding.learnt(
        design["encoder"], seen_by_encoder(signals, window, levels), start, n_steps,
        labels.codes, labels.n_classes, labels.train,
    )  # fmt: skip


def _fitted(before: Resolved, after: Resolved) -> dict[str, dict[str, Any]]:
    """Return the keys of each section that were fitted to the recordings."""
    found = {}
    for name in ("preprocessing", "encoder"):
        old, new = before.get(name) or {}, after.get(name) or {}
        changed = {key: value for key, value in new.items() if key not in old or old[key] != value}
        if changed:
            found[name] = changed
    return found


def find(root: Path, key: str) -> Dataset | None:
    """Return a data set of a cache, or None where it has to be prepared; a damaged one is removed.

    Raises:
        OSError: the cache cannot be written.
    """
    folder = cache.find(root, key)
    if folder is None:
        return None
    spikes = None
    try:
        spikes = read_meta(folder)["spikes"]
        if cache.find(root, spikes) is not None:
            return load(folder)
    except RecordingError:
        if spikes is not None:
            cache.discard(root, spikes)
    cache.discard(root, key)
    return None


def load_or_prepare(resolved: Resolved, base: Path, folder: Path, threads: int = 1) -> Dataset:
    """Return a prepared data set; one that was evicted or damaged since is prepared again.

    Args:
        resolved: as for `prepare`.
        base: as for `prepare`.
        folder: of the data set in its cache.
        threads: as for `prepare`.

    Raises:
        RecordingError: as for `prepare`, or the recordings have changed.
        OSError: the cache cannot be written.
    """
    try:
        dataset = load(folder)
    except RecordingError:
        find(folder.parent, folder.name)  # removes what is damaged
        prepared = _result(prepare(resolved, base, folder.parent, threads))
        if prepared != folder:
            raise RecordingError(f"{folder}: the recordings have changed since they were prepared") from None
        return load(prepared)
    spikes = folder.parent / read_meta(folder)["spikes"]
    for used in (folder, spikes):
        cache.mark_used(used)
    return dataset


def warnings(folder: Path) -> list[str]:
    """Return what is suspicious about the recordings of a prepared data set."""
    return list(read_meta(folder)["warnings"])


def transductive(folder: Path) -> str:
    """Return why what is evaluated on a prepared data set has seen its own answers; '' where it has not."""
    return str(read_meta(folder)["transductive"])


def as_prepared(resolved: Resolved, folder: Path) -> dict[str, Any]:
    """Return a design with what its prepared data set has fitted to the recordings in place of how."""
    found = read_meta(folder)["fitted"]
    return {**resolved, **{name: {**resolved[name], **keys} for name, keys in found.items()}}


def build(resolved: Resolved, base: Path, threads: int = 1) -> tuple[Dataset, list[str]]:
    """Return the data set of a design, kept nowhere, and what is suspicious about its recordings.

    Raises:
        RecordingError: as for `prepare`.
    """
    with tempfile.TemporaryDirectory() as folder:
        prepared = _result(prepare(resolved, base, Path(folder), threads))
        return load(prepared), warnings(prepared)  # what is mapped stays when its file is gone


def build_for(resolved: Resolved, base: Path, classes: Sequence[str]) -> tuple[Dataset, list[str]]:
    """Return a data set of new recordings, all of them in `test`, and what had to be repaired in them.

    They are prepared as `prepare` would, with what it has fitted to the data that was trained on.

    Args:
        resolved: as `as_prepared` returns it, with section `data` naming the new file; split and test are
            not read.
        base: folder that the file is looked up beside.
        classes: those of the data that was trained on.

    Raises:
        RecordingError: anything wrong with the recordings, or labels that are none of the classes. A file
            that lacks a column of the target is no fault: its targets are -1.
    """
    source: Source = component("recordings", resolved["data"])
    recordings, positions = _read(source.with_columns_found(base), base, resolved)
    n = recordings.n_recordings
    settings = resolved["task"]["target"]
    codes = np.full(n, -1, dtype=np.int64)
    if set(target_columns(settings)) <= set(recordings.columns):
        codes = _codes_of(recordings, settings, tuple(classes), "the new recordings")
    every = np.ones(n, dtype=bool)
    found = _kept_nowhere(_result(placed(recordings, resolved, every, positions=positions)))
    if resolved.get("encoder") and not isinstance(recordings, Signals):
        found = _kept_nowhere(encoding.encoded(found, resolved["encoder"], every))
    none = np.zeros(0, dtype=np.int64)
    return joined(found, tuple(classes), codes, none, none, np.arange(n)), found.notes


def _kept_nowhere(part: Part) -> Stored:
    """Return the spikes of a source; what is mapped stays when its file is gone."""
    with tempfile.TemporaryDirectory() as folder:
        _result(write_spikes([part], Path(folder)))
        return read_spikes(Path(folder))


def _result(telling: Telling[Result]) -> Result:
    """Return what a generator returns at its end."""
    while True:
        try:
            next(telling)
        except StopIteration as end:
            result: Result = end.value
            return result


def _read(source: Source, base: Path, resolved: Resolved) -> tuple[Recordings, Array | None]:
    """Return recordings, cut into pieces where that is asked for, and where their channels lie."""
    window = section(Window, resolved.get("window"))
    recordings = cut(source.read(base), window.cut_steps, window.every_steps)
    return recordings, source.channel_positions(base)


def _check_alike(parts: Sequence[Part]) -> None:
    for other in parts[1:]:
        for name, a, b in (
            ("channels", parts[0].n_channels, other.n_channels),
            ("ms per step", parts[0].step_ms, other.step_ms),
            ("steps per window", parts[0].n_steps, other.n_steps),
        ):
            if a != b:
                raise RecordingError(f"the test file must have {a} {name}, as the data file, got {b}")
        if not np.array_equal(parts[0].positions, other.positions):
            raise RecordingError("the test file must have the same channel positions as the data file")


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
