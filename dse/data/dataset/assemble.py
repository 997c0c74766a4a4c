"""A resolved design -> Dataset: read recordings, place windows, split, turn into spikes."""

from __future__ import annotations

import dataclasses
import functools
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dse.base.records import Bools, Dataset, Ints, Rasters, Signals, Spikes
from dse.config.bounds import MOST_PIXELS
from dse.config.parts import target_columns
from dse.config.resolved import LeftOut, Sections
from dse.config.settings import Target, Window
from dse.data.dataset import cache, encoding
from dse.data.dataset.files import (
    Meta,
    Stored,
    joined,
    load,
    read_meta,
    read_spikes,
    write_dataset,
    write_spikes,
)
from dse.data.dataset.keys import dataset_key, spikes_key, widened
from dse.data.dataset.parts import (
    Part,
    Progress,
    cropped,
    encoded_without,
    place_signals,
    placed,
    refusals,
    seen_by_encoder,
    silent,
)
from dse.data.dataset.shifts import shifts_described
from dse.data.recordings import RecordingError, Recordings, Source
from dse.data.recordings.doubts import Used, doubts, drawn, guard, shortcuts, silent_windows
from dse.data.recordings.splits import Labelled, in_turn, leak, without
from dse.data.recordings.targets import target
from dse.data.recordings.windows import chosen, cut
from dse.store import heads_document

_ROUNDING = 0.1  # share of spikes that the rounding of levels may move
_FEW = 64  # recordings that tell whether spikes follow the level


@dataclasses.dataclass(frozen=True)
class _Read:
    """Recordings of one file: what they are, where their channels lie, and which are in use, (n,) bool."""

    recordings: Recordings
    positions: Ints | None
    used: Bools


def prepare(
    design: Sections,
    base: Path,
    root: Path,
    threads: int = 1,
    progress: Progress = silent,
    only: Ints | None = None,
) -> Path:
    """Return the folder of a design's data set in a cache; the data set is made if it is absent.

    Sample i is recording i of the data; recordings of a `test` file follow. Recordings in no part of the
    split have no spikes. The classes are those of the recordings in use; the target of others is -1.
    Designs that differ in labels alone share their spikes.

    Args:
        design: its sections.
        base: folder that recordings are looked up beside.
        root: of the cache.
        threads: for trials that are simulated; the result is the same with any number.
        progress: called with a sentence as recordings are read and their spikes written.
        only: recordings that the parts of the split are limited to, and no test file; None: all.

    Raises:
        RecordingError: anything wrong with the recordings or with what is asked of them.
        OSError: the cache cannot be written.
    """
    making = _Making(base, root, threads, progress, only)
    wide = widened(design)
    jitter = None if wide is design else design.window.jitter_steps
    key = dataset_key(design, base, only)
    return cache.made(root, key, lambda folder: _fill(folder, wide, making, jitter))


def split_of(recordings: Recordings, design: Sections) -> tuple[Ints, Ints, Ints]:
    """Return the train, validation and test recordings of a design's data, test file aside; rising indices.

    Raises:
        RecordingError: the split does not fit the recordings.
    """
    of = Labelled.of(recordings.columns, design.task, design.split)
    return of.train, of.validation, of.test


@dataclasses.dataclass(frozen=True)
class _Making:
    """The arguments of `prepare` that are the same for every design."""

    base: Path
    root: Path
    threads: int
    progress: Progress
    only: Ints | None = None


def _fill(folder: Path, design: Sections, making: _Making, jitter_steps: int | None) -> None:
    """Write a data set to a folder of the cache, after its spikes.

    The windows of the design have room for all shifts; training windows move by `jitter_steps`, where that is
    less.
    """
    recordings, positions = _read(design.data, making.base, design.window)
    task = design.task
    guard(target_columns(task.target), design.split.columns())
    of = Labelled.of(recordings.columns, task, design.split, making.only)
    codes, classes, train, validation, test = of.codes, of.classes, of.train, of.validation, of.test
    reasons = [leak(of, design.split, design.window)]
    out: list[LeftOut] = []
    if design.evaluation is not None and design.left_out is None:
        out, faults = in_turn(of, design.evaluation.groups)
        if faults:
            raise RecordingError("\n".join(faults))
    sources, targets = [_Read(recordings, positions, of.used)], [codes]
    left_out, held = design.left_out, test
    if left_out is not None:  # with the spikes of the whole, those of who is left out among them
        train, validation, held = without(recordings.columns, left_out, train, validation)
        of = dataclasses.replace(of, train=train, validation=validation)
    joint = of.heads
    fitted = cropped(recordings, design, train, making.progress)
    if design.test is not None and making.only is None:
        if len(test):
            raise RecordingError(
                "test recordings must come either from split.test or from the test file, not from both"
            )
        other, places = _read(design.test, making.base, design.window)
        sources.append(_Read(other, places, np.ones(other.n_recordings, dtype=bool)))
        targets.append(_codes_of(other, task.target, classes, "the test file"))
        test = len(codes) + np.arange(len(targets[1]))
    test = test if left_out is None else held
    name, fitted, spikes = _spikes(sources, fitted, of, making)
    stored = read_spikes(spikes)
    seen = {head.name: head.of_class[codes] for head in joint}
    seen = seen or {" and ".join(target_columns(task.target)): codes}
    follow = functools.partial(_follow_levels, recordings, fitted, drawn(validation, _FEW))
    traps = [
        trap
        for what, labels_of in seen.items()
        for trap in shortcuts(stored.lengths, stored.levels, labels_of, train, validation, what, follow)
    ]
    if left_out is None:
        n_spikes = np.diff(stored.spikes.row_offsets[:: stored.spikes.n_steps])
        traps += doubts(Used(recordings, of, stored.n_steps, positions, " and ".join(seen)))
        traps += silent_windows(n_spikes[np.flatnonzero(of.used)])
    reasons.append(fitted.reads_labels)
    shifts = None if left_out is not None or design.evaluation is None else design.evaluation.shifts
    if shifts is not None:
        jitter = design.window.jitter_steps if jitter_steps is None else jitter_steps
        traps += shifts_described(of, stored.start, (stored.low, stored.high), shifts, jitter)
    left_out_in_turn = [{"column": x.column, "values": list(x.values)} for x in out]
    meta = Meta(
        name, list(classes), fitted.fitted_since(design), [*stored.notes, *traps], heads_document(joint),
        "; ".join(filter(None, reasons)), jitter_steps, left_out_in_turn or None,
    )  # fmt: skip
    write_dataset(folder, np.concatenate(targets), (train, validation, test), meta)


def _follow_levels(recordings: Recordings, design: Sections, samples: Ints) -> bool:
    """Return whether spikes change with the resting level: their counts in 16 bins of some windows."""
    if not isinstance(recordings, Signals) or design.encoder is None or design.encoder.transductive:
        return True
    some, used = chosen(recordings, samples), np.ones(len(samples), bool)
    levels = place_signals(some, design.window, used)[1]
    nothing = np.zeros_like(levels)
    with refusals():
        before, after = (
            _binned(encoded_without(some, design, used, constant, nothing)) for constant in (nothing, levels)
        )
    return bool(np.abs(before - after).sum() > _ROUNDING * (before + after).sum())


def _binned(spikes: Spikes) -> Ints:
    """Return the spikes in each sixteenth of a window, by sample and channel, in one row."""
    n_rows, bins = len(spikes.row_offsets) - 1, 16
    row = np.repeat(np.arange(n_rows), np.diff(spikes.row_offsets))
    cell = row // spikes.n_steps * bins + row % spikes.n_steps * bins // spikes.n_steps
    n_cells = n_rows // spikes.n_steps * bins * spikes.n_channels
    return np.bincount(cell * spikes.n_channels + spikes.channel, minlength=n_cells)


def _spikes(
    sources: Sequence[_Read], design: Sections, of: Labelled, making: _Making
) -> tuple[str, Sections, Path]:
    """Return the key of the spikes, the design with its encoder fitted, and the folder of the spikes.

    Recordings of events and rasters that pass an encoder have an entry without it too: designs that differ
    in the encoder share it.
    """
    used, first = [source.used for source in sources], sources[0].recordings

    def fill(folder: Path) -> None:
        parts = [
            placed(x.recordings, design, x.used, making.threads, x.positions, making.progress)
            for x in sources
        ]
        _check_alike(parts)
        write_spikes(parts, folder, making.threads, making.progress)

    if isinstance(first, Signals):
        if design.encoder is not None and design.encoder.learns:
            (start, _, _, n_steps), levels = place_signals(first, design.window, used[0])
            shown = seen_by_encoder(first, design.window, levels)
            encoder = encoding.learnt(design.encoder, shown, start, n_steps, of)
            design = dataclasses.replace(design, encoder=encoder)
    if design.encoder is None or isinstance(first, Signals):
        name = spikes_key(design, making.base, used)
        return name, design, cache.made(making.root, name, fill)

    bare = spikes_key(dataclasses.replace(design, encoder=None), making.base, used)
    encoder = design.encoder
    if encoder.learns:
        stored = read_spikes(cache.made(making.root, bare, fill))
        encoder = encoding.learnt_from_spikes(encoder, stored, used[0], of)
        design = dataclasses.replace(design, encoder=encoder)

    def fill_encoded(folder: Path) -> None:
        stored = read_spikes(cache.made(making.root, bare, fill))
        part = encoding.encoded(stored, encoder, np.concatenate(used))
        write_spikes([part], folder, progress=making.progress)

    name = spikes_key(design, making.base, used)
    return name, design, cache.made(making.root, name, fill_encoded)


def find(root: Path, key: str) -> Dataset | None:
    """Return a data set of a cache, or None if it must be prepared; a damaged one is removed."""
    folder = cache.find(root, key)
    if folder is None:
        return None
    spikes = None
    try:
        spikes = read_meta(folder).spikes
        if cache.find(root, spikes) is not None:
            return load(folder)
    except RecordingError:
        if spikes is not None:
            cache.discard(root, spikes)
    cache.discard(root, key)
    return None


def load_or_prepare(design: Sections, base: Path, folder: Path, threads: int = 1) -> Dataset:
    """Return the data set that `prepare` made in a folder; it is made again if it was evicted or damaged.

    Raises:
        RecordingError: as for `prepare`, or the recordings have changed.
        OSError: the cache cannot be written.
    """
    dataset = find(folder.parent, folder.name)
    if dataset is None:
        prepared = prepare(design, base, folder.parent, threads)
        if prepared != folder:
            raise RecordingError(f"{folder}: the recordings have changed since they were prepared")
        return load(prepared)
    return dataset


def lengths(folder: Path) -> Ints:
    """Return (n,) steps of the recordings of a prepared data set, without those of a test file."""
    return np.asarray(read_spikes(folder.parent / read_meta(folder).spikes).lengths)


def recordings(design: Sections, base: Path) -> Recordings:
    """Return the recordings of a design, cut into windows if it says so; sample i of its data set is one.

    Raises:
        RecordingError: anything wrong with the recordings.
    """
    return _read(design.data, base, design.window)[0]


def left_out(folder: Path) -> list[LeftOut]:
    """Return the groups that the evaluation of a prepared data set leaves out of training in turn."""
    return [LeftOut(x["column"], tuple(x["values"])) for x in read_meta(folder).left_out or ()]


def as_prepared(design: Sections, folder: Path) -> Sections:
    """Return a design with the values that its prepared data set has fitted to the recordings."""
    return design.with_fitted(read_meta(folder).fitted)


def build(
    design: Sections, base: Path, threads: int = 1, progress: Progress = silent
) -> tuple[Dataset, list[str]]:
    """Return the data set of a design and the warnings about its recordings; nothing is stored.

    Raises:
        RecordingError: as for `prepare`.
    """
    with tempfile.TemporaryDirectory() as folder:
        prepared = prepare(design, base, Path(folder), threads, progress)
        return load(prepared), read_meta(prepared).warnings  # what is mapped stays when its file is gone


class New(NamedTuple):
    """New recordings, prepared for a classifier.

    dataset: all of them in `test`. notes: what was repaired.
    recordings: as read, cut into windows if the settings say so.
    first: (n,) step of each recording at which its stored steps begin.
    """

    dataset: Dataset
    notes: list[str]
    recordings: Recordings
    first: Ints


def build_for(design: Sections, base: Path, classes: Sequence[str], only: Ints | None = None) -> New:
    """Return a data set of new recordings, all of them in `test`, as `prepare` would make it.

    The design is as `as_prepared` returns it, with `data` naming the new file; split and test are not read.
    classes: those of the data that was trained on. only: recordings that are read, rising; None: all.

    Raises:
        RecordingError: anything wrong with the recordings, or labels that are none of the classes. A file
            that lacks a column of the target is no fault: its targets are -1.
    """
    recordings, positions = _read(design.data.with_columns_found(base), base, design.window)
    n, task_target = recordings.n_recordings, design.task.target
    codes: Ints = np.full(n, -1, dtype=np.int64)
    if set(target_columns(task_target)) <= set(recordings.columns):
        codes = _codes_of(recordings, task_target, tuple(classes), "the new recordings")
    chosen = np.arange(n) if only is None else only
    used = np.isin(np.arange(n), chosen)
    part = placed(recordings, design, used, positions=positions)
    stored = _stored_temporarily(part)
    if design.encoder is not None and recordings.front_end != "encoder":
        stored = _stored_temporarily(encoding.encoded(stored, design.encoder, used))
    none = np.zeros(0, dtype=np.int64)
    dataset = joined(stored, tuple(classes), codes, none, none, chosen)
    assert part.first is not None  # placed has it
    return New(dataset, stored.notes, recordings, part.first)


def _stored_temporarily(part: Part) -> Stored:
    """Return the spikes of a source; what is mapped stays when its file is gone."""
    with tempfile.TemporaryDirectory() as folder:
        write_spikes([part], Path(folder))
        return read_spikes(Path(folder))


def _read(source: Source, base: Path, window: Window) -> tuple[Recordings, Ints | None]:
    """Return recordings, cut into windows if the settings say so, and the positions of their channels."""
    read = source.read(base)
    if not isinstance(read, Rasters | Signals) and (n_pixels := read.width * read.height) > MOST_PIXELS:
        size = f"{read.width} x {read.height} = {n_pixels}"
        raise RecordingError(f"the frame must have at most {MOST_PIXELS} pixels, got {size}")
    return cut(read, window), source.channel_positions(base)


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


def _codes_of(recordings: Recordings, task_target: Target, classes: tuple[str, ...], where: str) -> Ints:
    codes, names = target(recordings.columns, task_target)
    for name in names:
        if name not in classes:
            raise RecordingError(f"{where}: class '{name}' is unknown; the classes are {', '.join(classes)}")
    index = np.array([classes.index(name) for name in names], dtype=np.int64)
    return np.asarray(index[codes])
