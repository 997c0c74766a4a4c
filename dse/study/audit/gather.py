"""The first design of a search space -> what its probes read."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from dse.base.records import Bools, Rasters, Signals
from dse.config import SearchSpace
from dse.config.parts import target_columns
from dse.config.resolved import Sections
from dse.config.settings import Window
from dse.config.space import Design
from dse.config.values import echo
from dse.data import dataset
from dse.data.dataset.parts import Progress, encoded_without, place_signals, silent
from dse.data.recordings import RecordingError, trials_of
from dse.data.recordings.doubts import MOST, drawn
from dse.search.space import corners
from dse.study.audit import position
from dse.study.audit.material import Levels, Material

MOST_SIMULATED = (800, 300, 300)
"""Training, validation and test samples of simulated touch, half a tenth of a second each, that are read: no
more of it is simulated than the probes use."""

_MOST_ENCODERS = 1000
_DATA = ("task", "window", "preprocessing", "encoder")


def designs(space: SearchSpace) -> Iterator[Design]:
    """Yield the first design of a search space for every target; all other axes have their first value."""
    first = next(corners(space, (), 1))
    axis = space.axes.get("task.target")
    for value in (None,) if axis is None else axis.values or ():
        yield first if axis is None else first | {axis.name: value}


def without_labels(space: SearchSpace, design: Design) -> Design | None:
    """Return the first design for the same target whose encoder reads no labels; None where there is none."""
    target = {name: design[name] for name in ("task.target",) if name in design}
    others = (other | target for other in corners(space, ("encoder",), _MOST_ENCODERS))
    return next((other for other in others if not sections_of(space, other).reads_labels), None)


def values_of(design: Design) -> str:
    """Return the values of a design on the axes of the data, without the target, in words."""
    axes = (name for name in design if name.split(".")[0] in _DATA and name != "task.target")
    return ", ".join(f"{name} {echo(design[name])}" for name in axes)


def sections_of(space: SearchSpace, design: Design) -> Sections:
    """Return the sections that an audit reads: what else a study evaluates does not matter.

    Raises:
        RecordingError: a component refuses values of the design that are legal one by one.
    """
    try:
        return dataclasses.replace(space.resolve(design), evaluation=None)
    except ValueError as error:
        raise RecordingError(str(error)) from None


def material(
    space: SearchSpace, design: Design, root: Path, shifts: Sequence[int] = (), progress: Progress = silent
) -> Material:
    """Prepare the data set of a design, with room to move its windows, and return what probes read.

    shifts: as of `audit.audit`.

    Raises:
        RecordingError: the recordings do not fit the search space.
        OSError: the cache cannot be written.
    """
    base, sections = space.source.parent, sections_of(space, design)
    roomy = dataclasses.replace(sections, window=_with_room(sections.window, shifts))
    recordings = dataset.recordings(sections, base)
    simulated = not isinstance(recordings, Signals | Rasters) and trials_of(recordings) is not None
    of_split = dataset.split_of(recordings, sections)
    most = MOST_SIMULATED if simulated else (MOST,) * 3
    train, validation, test = map(drawn, of_split, most)
    only = np.concatenate([train, validation, test]) if simulated else None
    folder = dataset.prepare(roomy, base, root, space.execution.threads, progress, only)
    data = dataset.load(folder)
    test = test if simulated else drawn(data.test)
    levels = None
    if isinstance(recordings, Signals):
        prepared = dataset.as_prepared(sections, folder)
        assert prepared.encoder is not None  # signals without an encoder are refused
        if not prepared.encoder.transductive:
            used = np.isin(np.arange(recordings.n_recordings), np.concatenate([train, validation]))
            levels = _levels(recordings, prepared, used)
    return Material(
        task=space.task_name(design),
        dataset=data,
        train=train,
        validation=validation,
        test=test,
        data=dataset.dataset_key(space.resolve(design), base),
        drawn_from=(len(of_split[0]), len(of_split[1])),
        columns=recordings.columns,
        lengths=dataset.lengths(folder),
        target_columns=target_columns(sections.task.target),
        split_columns=sections.split.columns(),
        window=sections.window,
        levels=levels,
        leak=dataset.read_meta(folder).transductive,
        reads_labels=bool(sections.reads_labels),
    )


def _with_room(window: Window, shifts: Sequence[int]) -> Window:
    """Return a window that training may move far enough for the shifts; whole recordings have no room."""
    if window.n_steps is None:
        return window
    usual = max(1, window.n_steps // position.FRACTIONS[0])
    if window.jitter_steps:
        usual = max(usual, position.furthest(window.jitter_steps, window.n_steps))
    most = max(map(abs, shifts), default=usual)
    return dataclasses.replace(window, jitter_steps=max(window.jitter_steps, most))


def _levels(signals: Signals, design: Sections, used: Bools) -> Levels:
    (start, _, _, n_steps), level = place_signals(signals, design.window, used)
    first = signals.offsets[:-1] + start
    time = np.arange(n_steps) - (n_steps - 1) / 2
    slope = np.zeros_like(level)
    for i in np.flatnonzero(used):
        values = signals.values[first[i] : first[i] + n_steps].astype(np.float64)
        slope[i] = time @ values / max((time**2).sum(), 1.0)
    return Levels(level, slope, functools.partial(encoded_without, signals, design, used))
