"""Which steps of recordings a classifier sees: windows of one length, cut from long ones or padded.

A window may move in training.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from dse.base.records import Bools, Floats, Ints, Rasters, Signals, ranges
from dse.config.settings import Window
from dse.data.recordings import RecordingError, Recordings
from dse.data.recordings.splits import NUMBER, ORIGINAL


def place(
    window: Window, lengths: Ints, used: Bools, onset: Ints | None = None
) -> tuple[Ints, Ints, Ints, int]:
    """Return start, its lowest and highest value in training, each (n,) int64, and the window's length.

    The bounds are cut so that every crop lies in its recording; they are 0 for recordings that are not used.
    lengths: (n,) steps. used: (n,) bool. onset: (n,) first step of contact, -1 where there is none; needed by
    `at: contact_onset`.

    Raises:
        RecordingError: a window does not fit its recording, or lengths differ and no window length is given.
    """
    lengths = np.where(used, lengths, 0).astype(np.int64)
    first = int(used.argmax())
    n_steps = window.n_steps
    if n_steps is None:
        other = used & (lengths != lengths[first])
        if other.any():
            raise RecordingError(
                f"window.n_steps is required because recordings differ in length: recording {first} has "
                f"{lengths[first]} steps, recording {other.argmax()} has {lengths[other.argmax()]}"
            )
        n_steps = int(lengths[first])
    start = np.zeros_like(lengths)
    if window.at == "middle":
        start = (lengths - n_steps) // 2
    elif window.at == "contact_onset":
        if onset is None:
            raise ValueError("place needs onset for a window at contact_onset, got None")
        start = onset.astype(np.int64)
        if (used & (start < 0)).any():
            raise RecordingError(
                f"recording {(used & (start < 0)).argmax()} has no contact onset at "
                f"window.onset_threshold = {window.onset_threshold:g}"
            )
    short = used & ((lengths < n_steps) | (start + n_steps > lengths))
    if short.any():
        i = int(short.argmax())
        since = f" from its contact onset at step {start[i]}" if window.at == "contact_onset" else ""
        raise RecordingError(
            f"a window of {n_steps} steps does not fit recording {i}{since}: it has {lengths[i]} steps"
        )
    low = np.maximum(start - window.jitter_steps, 0)
    high = np.minimum(start + window.jitter_steps, lengths - n_steps)
    return np.where(used, start, 0), np.where(used, low, 0), np.where(used, high, 0), n_steps


def onset(recordings: Signals | Rasters, window: Window) -> Ints | None:
    """Return (n,) the first step of contact, -1 where there is none; None: no window begins there.

    That is where a channel differs from its first sample by the threshold, or a step has so many spikes.
    """
    if window.at != "contact_onset":
        return None
    if isinstance(recordings, Rasters):
        counts = np.diff(recordings.spikes.row_offsets).reshape(recordings.lengths.size, -1)
        enough = counts >= window.onset_threshold
        return np.where(enough.any(axis=1), enough.argmax(axis=1), -1)
    onset = np.full(recordings.n_recordings, -1, dtype=np.int64)
    for i in range(recordings.n_recordings):
        values = recordings.values[recordings.offsets[i] : recordings.offsets[i + 1]]
        moved = (np.abs(values - values[0]) >= window.onset_threshold).any(axis=1)
        if moved.any():
            onset[i] = moved.argmax()
    return onset


def mean_levels(signals: Signals, start: Ints, n_steps: int) -> Floats:
    """Return the mean of every channel over its window: (n, channel) float64."""
    first = signals.offsets[:-1] + start
    last = np.minimum(first + n_steps, signals.offsets[1:])
    return np.stack(
        [signals.values[a:b].mean(axis=0, dtype=np.float64) for a, b in zip(first, last, strict=True)]
    )


def chosen(signals: Signals, samples: Ints) -> Signals:
    """Return some of the recordings."""
    return _pieces(signals, samples, np.zeros_like(samples), signals.lengths[samples])


def without_mean(signals: Signals, levels: Floats) -> Signals:
    """Return the recordings with `levels` (n, channel) subtracted."""
    shift = np.repeat(levels, signals.lengths, axis=0)
    return dataclasses.replace(signals, values=(signals.values - shift).astype(np.float32))


# ---- long recordings, short recordings


def cut(recordings: Recordings, window: Window) -> Recordings:
    """Return windows of `cut_steps` steps, one every `every_steps`, from the first step of each recording on.

    Steps after the last window of a recording are dropped. Windows keep the order of their recordings and of
    time, and repeat the columns of their recording; column `recording` numbers the recording, `window` the
    window within it. Without `every_steps`, windows do not overlap; without `cut_steps` they are the
    recordings, short ones padded where `pad` says so.

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
    original, number = _windows(recordings.lengths, cut_steps, every)
    numbers = {ORIGINAL: original, NUMBER: number}
    columns = {name: values[original] for name, values in recordings.columns.items()} | numbers
    if isinstance(recordings, Rasters):
        spikes = recordings.spikes.pieces(original, number * every, cut_steps)
        return dataclasses.replace(recordings, spikes=spikes, columns=columns)
    windows = _pieces(recordings, original, number * every, np.full(len(original), cut_steps))
    return dataclasses.replace(windows, columns=columns)


def _padded(recordings: Recordings, n_steps: int) -> Signals:
    """Return recordings of n_steps at least, which hold their last sample to the end."""
    if not isinstance(recordings, Signals):
        raise RecordingError("window.pad is for sampled signals")
    before, lengths = recordings.lengths, np.maximum(recordings.lengths, n_steps)
    step = ranges(np.zeros(len(lengths), np.int64), lengths)
    places = np.repeat(recordings.offsets[:-1], lengths) + np.minimum(step, np.repeat(before, lengths) - 1)
    offsets = np.concatenate([[0], np.cumsum(lengths)])
    return dataclasses.replace(recordings, values=recordings.values[places], offsets=offsets)


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
    return original, ranges(np.zeros(len(lengths), dtype=np.int64), n_windows)


# ---- pieces of recordings


def _pieces(signals: Signals, samples: Ints, first: Ints, lengths: Ints) -> Signals:
    """Return steps first[k] .. first[k] + lengths[k] - 1 of recording samples[k] as recordings."""
    return dataclasses.replace(
        signals,
        values=signals.values[ranges(signals.offsets[samples] + first, lengths)],
        offsets=np.concatenate([[0], np.cumsum(lengths)]),
        columns={name: values[samples] for name, values in signals.columns.items()},
    )
