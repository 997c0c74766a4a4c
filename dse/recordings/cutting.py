"""Long recordings -> windows, each a recording itself; short ones -> as long as the window."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from dse.config.settings import Window
from dse.recordings import RecordingError, Recordings
from dse.recordings.splits import NUMBER, ORIGINAL
from dse.records import Array, Ints, Rasters, Signals, Spikes


def cut(recordings: Recordings, window: Window) -> Recordings:
    """Return windows of `cut_steps` steps, one every `every_steps`, from the first step of each recording on.

    Steps after the last window of a recording are dropped. Windows keep the order of their recordings and of
    time, and repeat the columns of their recording; column `recording` numbers the recording, `window` the
    window within it. Without `cut_steps` they are the recordings, short ones padded where `pad` says so.

    Args:
        recordings: sampled signals or rasters.
        window: settings; without `every_steps`, windows do not overlap.

    Raises:
        RecordingError: recordings of events, a recording shorter than a window, or columns of these names.
    """
    cut_steps = window.cut_steps
    if cut_steps is None:
        return _padded(recordings, window.n_steps or 0) if window.pad else recordings
    if not isinstance(recordings, Signals | Rasters):
        raise RecordingError(
            f"window.cut_steps does not apply to events, which have no steps; got {cut_steps}"
        )
    for name in (ORIGINAL, NUMBER):
        if name in recordings.columns:
            raise RecordingError(
                f"data.columns cannot contain '{name}' together with window.cut_steps, which creates this "
                "column"
            )
    every = window.every_steps or cut_steps
    if isinstance(recordings, Rasters):
        return _of_rasters(recordings, cut_steps, every)
    return _of_signals(recordings, cut_steps, every)


def _padded(recordings: Recordings, n_steps: int) -> Signals:
    """Return recordings of n_steps at least, which hold their last sample to the end."""
    if not isinstance(recordings, Signals):
        raise RecordingError("window.pad is for sampled signals")
    before, lengths = recordings.lengths, np.maximum(recordings.lengths, n_steps)
    step = _ranges(np.zeros(len(lengths), np.int64), lengths)
    places = np.repeat(recordings.offsets[:-1], lengths) + np.minimum(step, np.repeat(before, lengths) - 1)
    offsets = np.concatenate([[0], np.cumsum(lengths)])
    return dataclasses.replace(recordings, values=recordings.values[places], offsets=offsets)


def _of_signals(signals: Signals, cut_steps: int, every: int) -> Signals:
    original, number = _windows(signals.lengths, cut_steps, every)
    first = signals.offsets[original] + number * every
    return dataclasses.replace(
        signals,
        values=signals.values[_ranges(first, np.full(len(first), cut_steps))],
        offsets=np.arange(len(first) + 1, dtype=np.int64) * cut_steps,
        columns=_columns(signals.columns, original, number),
    )


def _of_rasters(rasters: Rasters, cut_steps: int, every: int) -> Rasters:
    spikes = rasters.spikes
    original, number = _windows(rasters.lengths, cut_steps, every)
    row = original * spikes.n_steps + number * every
    counts = np.diff(spikes.row_offsets)[_ranges(row, np.full(len(row), cut_steps))]
    first, last = spikes.row_offsets[row], spikes.row_offsets[row + cut_steps]
    windows = Spikes(
        row_offsets=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        channel=spikes.channel[_ranges(first, last - first)],
        n_steps=cut_steps,
        n_channels=spikes.n_channels,
        step_ms=spikes.step_ms,
    )
    return dataclasses.replace(rasters, spikes=windows, columns=_columns(rasters.columns, original, number))


def _windows(lengths: Ints, cut_steps: int, every: int) -> tuple[Ints, Ints]:
    """Return the recording of every window and its number in it, each (n_windows,) int64."""
    short = lengths < cut_steps
    if short.any():
        i = int(short.argmax())
        raise RecordingError(
            f"window.cut_steps = {cut_steps} does not fit recording {i}: it has {lengths[i]} steps"
        )
    n_windows = (lengths - cut_steps) // every + 1
    original = np.repeat(np.arange(len(lengths)), n_windows)
    return original, _ranges(np.zeros(len(lengths), dtype=np.int64), n_windows)


def _ranges(first: Ints, length: Ints) -> Ints:
    """Return first[0], first[0] + 1, ... of the given lengths, one range after the other."""
    before = np.cumsum(length) - length
    return np.asarray(np.repeat(first - before, length) + np.arange(int(length.sum())), dtype=np.int64)


def _columns(columns: Mapping[str, Array], original: Ints, number: Ints) -> dict[str, Array]:
    return {name: values[original] for name, values in columns.items()} | {ORIGINAL: original, NUMBER: number}
