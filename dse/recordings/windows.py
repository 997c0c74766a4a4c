"""Which steps of a recording a classifier sees: a window of one length, and room to move it in training."""

from __future__ import annotations

import dataclasses

import numpy as np

from dse.config.settings import Window
from dse.recordings import RecordingError
from dse.records import Bools, Floats, Ints, Signals


def place(
    window: Window, lengths: Ints, used: Bools, onset: Ints | None = None
) -> tuple[Ints, Ints, Ints, int]:
    """Return start, its lowest and highest value in training, each (n,) int64, and the window's length.

    The bounds are cut so that every crop lies in its recording; they are 0 for recordings that are not used.

    Args:
        window: settings.
        lengths: (n,) steps per recording.
        used: (n,) bool, recordings that need a window.
        onset: (n,) first step of contact, -1 where there is none; needed by `at: contact_onset`.

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


def signal_onset(signals: Signals, threshold: float) -> Ints:
    """Return (n,) the first step where any channel differs from its first sample by `threshold`, or -1."""
    onset = np.full(signals.n_recordings, -1, dtype=np.int64)
    for i in range(signals.n_recordings):
        values = signals.values[signals.offsets[i] : signals.offsets[i + 1]]
        moved = (np.abs(values - values[0]) >= threshold).any(axis=1)
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
    offsets = np.concatenate([[0], np.cumsum(signals.lengths[samples])])
    values = [signals.values[signals.offsets[i] : signals.offsets[i + 1]] for i in samples]
    columns = {name: labels[samples] for name, labels in signals.columns.items()}
    return dataclasses.replace(signals, values=np.concatenate(values), offsets=offsets, columns=columns)


def without_mean(signals: Signals, levels: Floats) -> Signals:
    """Return the recordings with `levels` (n, channel) subtracted."""
    shift = np.repeat(levels, signals.lengths, axis=0)
    return dataclasses.replace(signals, values=(signals.values - shift).astype(np.float32))
