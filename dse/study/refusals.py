"""What a run would refuse in a search space and its recordings: all of it, before any work."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from dse.config import SearchSpace
from dse.config.contracts import check_channels, placed, trains_in_cohorts
from dse.config.resolved import Sections
from dse.config.yaml_lines import Path as Keys
from dse.dataset.shape import Shape, announced
from dse.recordings import RecordingError, Recordings
from dse.recordings.cutting import cut
from dse.recordings.splits import split
from dse.recordings.targets import heads, in_use, target
from dse.recordings.windows import place, signal_onset
from dse.records import Ints, Rasters, Signals
from dse.search.space import corners
from dse.study.workers import Workers

_MOST_CORNERS = 256


class Refusal(NamedTuple):
    """A fault: the keys of the search space that it is about, and a sentence."""

    path: Keys
    message: str


def refusals(space: SearchSpace) -> list[Refusal]:
    """Return every fault that a run of a valid search space would meet in its recordings, each once.

    Designs at the ends of all axes are looked at. Events are read, but their windows are not placed, as these
    follow from the events of every file.
    """
    faults: dict[Refusal, None] = {}
    base = space.source.parent
    try:
        read: Recordings = space.data.read(base)
    except RecordingError as error:
        return [Refusal(("data", "file"), str(error))]
    seen: set[str] = set()
    for design in corners(space, ("task", "window"), _MOST_CORNERS):
        sections = space.resolve(design)
        key = repr((sections.task, sections.window))
        if key not in seen:
            seen.add(key)
            faults |= dict.fromkeys(_of_labels_and_windows(sections, read))
    if not faults:
        faults |= dict.fromkeys(_of_channels(space, read))
    if not faults and (fault := _too_large(space, read)) is not None:
        faults[fault] = None
    return list(faults)


def _of_labels_and_windows(design: Sections, read: Recordings) -> Iterator[Refusal]:
    """Yield what is wrong with cutting, classes, split and windows of a design."""
    try:
        recordings = cut(read, design.window.cut_steps, design.window.every_steps)
    except RecordingError as error:
        yield Refusal(("window", "cut_steps"), str(error))
        return
    try:
        codes, classes = target(recordings.columns, design.task.target)
        if design.task.joint:
            heads(recordings.columns, design.task.target, codes)
    except RecordingError as error:
        yield Refusal(("task", "target"), str(error))
        return
    used = np.ones(len(codes), dtype=bool)
    try:
        used[:] = False
        used[np.concatenate(split(recordings.columns, codes, classes, design.split))] = True
    except RecordingError as error:
        yield Refusal(("split",), str(error))
        used[:] = True
    n_classes = len(in_use(codes, classes, used)[1])
    if n_classes < 2:
        yield Refusal(
            ("task", "target"),
            f"task.target must have two classes or more in the recordings of the split, got {n_classes}",
        )
    if isinstance(recordings, Signals | Rasters):
        try:
            place(design.window, recordings.lengths, used, _onset(design, recordings))
        except RecordingError as error:
            yield Refusal(("window", "n_steps"), str(error))


def _onset(design: Sections, recordings: Signals | Rasters) -> Ints | None:
    """Return the first step of contact of each recording, where windows begin there."""
    window = design.window
    if window.at != "contact_onset":
        return None
    if isinstance(recordings, Signals):
        return signal_onset(recordings, window.onset_threshold)
    spikes = recordings.spikes
    enough = np.diff(spikes.row_offsets).reshape(recordings.lengths.size, -1) >= window.onset_threshold
    return np.where(enough.any(axis=1), enough.argmax(axis=1), -1)


def _shapes(space: SearchSpace, read: Recordings) -> Iterator[tuple[Sections, Shape]]:
    """Yield designs at the ends of all axes and the shapes of their data, up to one that the data decide."""
    of_file = space.data.channel_positions(space.source.parent)
    shapes: dict[str, Shape | None] = {}
    for design in corners(space, ("task", "preprocessing", "encoder", "model"), _MOST_CORNERS):
        sections = space.resolve(design)
        key = repr((sections.task, sections.window, sections.preprocessing, sections.encoder))
        if key not in shapes:
            try:
                recordings = cut(read, sections.window.cut_steps, sections.window.every_steps)
                shapes[key] = announced(sections, recordings, of_file)
            except (RecordingError, ValueError):
                return
        shape = shapes[key]
        if shape is None:
            return
        yield sections, shape


def _of_channels(space: SearchSpace, read: Recordings) -> Iterator[Refusal]:
    """Yield why designs cannot train on channels where they lie."""
    for sections, shape in _shapes(space, read):
        try:
            check_channels(sections.model, shape.positions)
        except ValueError as error:
            yield Refusal(("model",), str(error))


def _too_large(space: SearchSpace, read: Recordings) -> Refusal | None:
    """Return the fault of a search space in which no design fits the memory of a worker."""
    execution = space.execution
    budget = Workers(execution.jobs).memory_budget(execution.memory_gib, execution.device)
    least: tuple[int, int] | None = None
    for sections, shape in _shapes(space, read):
        if not trains_in_cohorts(sections.model):
            return None
        family, sizes = placed(sections.model, shape.positions), (len(shape.positions), shape.n_outputs)
        needed = family.memory_bytes(*sizes, shape.n_steps or 1, sections.training)
        least = min(filter(None, (least, (needed, family.n_weights(*sizes)))))
        if needed <= budget:
            return None
    if least is None:
        return None
    needed, n_weights = least
    return Refusal(
        ("model",),
        f"model: the smallest design has {n_weights} weights, and its training needs "
        f"{needed / 2**30:.3g} GiB, "
        f"more than the {budget / 2**30:.3g} GiB of a process (execution.memory_gib)",
    )
