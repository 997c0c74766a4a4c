"""Samples with times of their own -> samples every step_ms."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from dse.recordings import RecordingError
from dse.records import Floats, Ints
from dse.registry import param

UNITS_MS = {"s": 1000.0, "ms": 1.0, "us": 1e-3}


def time_unit_key() -> Any:
    """Declare the key `time_unit` of a component."""
    return param(None, doc="unit of the times (default: ms)", choices=tuple(UNITS_MS), axis=False)


def resample_key() -> Any:
    """Declare the key `resample` of a component."""
    return param(
        None,
        doc="linear: samples at uneven times are interpolated every step_ms, and a note says how many "
        "recordings (default: uneven times are a fault)",
        choices=("linear",),
        axis=False,
    )


def is_even(times_ms: Floats, step_ms: float) -> bool:
    """Return whether times rise by step_ms, to within half of it."""
    return bool((np.abs(np.diff(times_ms) - step_ms) <= step_ms / 2).all())


def grid_of(first_ms: float, last_ms: float, step_ms: float) -> Floats:
    """Return first_ms, first_ms + step_ms, ... up to last_ms."""
    n = int(np.floor((last_ms - first_ms) / step_ms + 1e-6)) + 1
    return first_ms + step_ms * np.arange(max(n, 0))


def interpolated(grid_ms: Floats, times_ms: Floats, values: Floats) -> Floats:
    """Return (sample, channel) values at the times of a grid, by linear interpolation."""
    return np.stack([np.interp(grid_ms, times_ms, values[:, k]) for k in range(values.shape[1])], axis=1)


def on_grid(
    times_ms: Floats,
    values: Floats,
    offsets: Ints,
    step_ms: float,
    name: Callable[[int], str],
    where: str,
) -> tuple[Floats, Ints, list[str]]:
    """Return recordings with a sample every step_ms, their borders, and a note where samples were made.

    Recordings whose times are even stay as they are.

    Args:
        times_ms: (sum of lengths,) times, which must rise within a recording.
        values: (sum of lengths, channel).
        offsets: (n + 1,) borders of the recordings.
        step_ms: distance of the new samples.
        name: the name of recording i.
        where: the file's name, for errors and the note.

    Raises:
        RecordingError: times do not rise, or a recording is shorter than a step.
    """
    parts, n_uneven, widest_ms = [], 0, 0.0
    for i in range(len(offsets) - 1):
        part = slice(int(offsets[i]), int(offsets[i + 1]))
        times = times_ms[part]
        if is_even(times, step_ms):
            parts.append(values[part])
            continue
        steps = np.diff(times)
        if (steps <= 0).any():
            k = int((steps <= 0).argmax())
            raise RecordingError(
                f"{where}: times must rise, got {times[k]:g} ms and then {times[k + 1]:g} ms in sample "
                f"{k + 1} of recording '{name(i)}'"
            )
        grid = grid_of(times[0], times[-1], step_ms)
        if len(grid) < 2:
            raise RecordingError(
                f"{where}: recording '{name(i)}' must last a step of {step_ms:g} ms, got "
                f"{times[-1] - times[0]:g}"
            )
        parts.append(interpolated(grid, times, values[part]))
        n_uneven, widest_ms = n_uneven + 1, max(widest_ms, float(steps.max()))
    borders = np.concatenate([[0], np.cumsum([len(part) for part in parts])]).astype(np.int64)
    return np.concatenate(parts), borders, resampled(n_uneven, len(parts), step_ms, widest_ms, where)


def resampled(n_uneven: int, n: int, step_ms: float, widest_ms: float, where: str) -> list[str]:
    """Return a sentence on the recordings whose samples were interpolated; nothing if there are none."""
    if not n_uneven:
        return []
    return [
        f"{where}: {n_uneven} of {n} recordings have samples at uneven times; they were interpolated every "
        f"{step_ms:g} ms (widest gap {widest_ms:g} ms)"
    ]
