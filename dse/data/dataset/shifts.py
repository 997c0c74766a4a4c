"""Windows at other positions of the same recordings."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from dse.base.records import Bools, Dataset, Ints
from dse.data.recordings import RecordingError
from dse.data.recordings.splits import Labelled


def has_room(dataset: Dataset, steps: int) -> Bools:
    """Return (n,) bool: whether the steps of a sample's window, moved by some steps, are stored.

    Samples without spikes have no room, except for 0. steps: > 0 later, < 0 earlier.
    """
    low, high = dataset.room
    return _fits(dataset.start, low, high, steps)


def _fits(start: Ints, low: Ints, high: Ints, steps: int) -> Bools:
    first = start.astype(np.int64) + steps
    return np.asarray((low <= first) & (first <= high))


def shifted(dataset: Dataset, steps: int) -> Dataset:
    """Return the data set with every evaluated window moved by some steps, as far as it has room."""
    start = np.clip(dataset.start + steps, *dataset.room)
    return dataclasses.replace(dataset, start=start.astype(np.int32))


def shifts_described(
    of: Labelled, start: Ints, room: tuple[Ints, Ints], shifts: Sequence[int], jitter_steps: int
) -> list[str]:
    """Return what is worth saying about moved windows, one sentence each.

    start: (n,) first step of the evaluated windows. room: lowest and highest that a recording has room for,
    each (n,). jitter_steps: how far training windows move.

    Raises:
        RecordingError: no recording has room for every shift.
    """
    codes, validation = of.codes, of.validation
    fits = np.all([_fits(start, *room, steps)[validation] for steps in shifts], axis=0)
    if not fits.any():
        back, ahead = ((start - room[0])[validation].max(), (room[1] - start)[validation].max())
        raise RecordingError(
            f"evaluation.shifts must all have room in some validation recording, got {list(shifts)}: windows "
            f"can move by -{back} to {ahead} steps at most"
        )
    outside = [shift for shift in shifts if abs(shift) > jitter_steps]
    sentences = []
    if outside:
        sentences.append(
            f"evaluation.shifts: {', '.join(map(str, outside))} lie outside the training crops "
            f"(window.jitter_steps: {jitter_steps})"
        )
    if not fits.all():
        lacking = np.setdiff1d(codes[validation], codes[validation][fits])
        names = ", ".join(f"'{of.classes[code]}'" for code in lacking)
        none = f"; none is of class {names}" if lacking.size else ""
        sentences.append(
            f"evaluation.shifts: {fits.sum()} of {fits.size} validation recordings have room for every "
            f"shift, and accuracy_shifted is of these{none}"
        )
    return sentences
