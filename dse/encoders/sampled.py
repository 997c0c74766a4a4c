"""What encoders of sampled signals have in common: copies of the channels, and smoothing."""

from __future__ import annotations

from collections import deque

import numpy as np

from dse.records import Floats, Ints, Signals


def copied(inputs: Ints, copies: int) -> Ints:
    """Return x, y and plane of several copies of the channels, (copies n_in, 3) int32, copy by copy.

    Copy k of plane q is plane q copies + k.

    Args:
        inputs: (n_in, 3) x, y and plane of the sampled channels.
        copies: spike trains of each channel.
    """
    positions = np.tile(np.asarray(inputs, dtype=np.int32), (copies, 1))
    positions[:, 2] = positions[:, 2] * copies + np.repeat(np.arange(copies, dtype=np.int32), len(inputs))
    return positions


def smoothed(signals: Signals, i: int, first: int, length: int, smoothing_ms: float) -> Floats:
    """Return some steps of recording i, (length, channel) float64, smoothed from its first sample on."""
    values = signals.values[signals.offsets[i] : signals.offsets[i + 1]]
    return moving_average(values, round(smoothing_ms / signals.step_ms), first, length)


def moving_average(values: Floats, window: int, first: int, length: int) -> Floats:
    """Return the mean of the last `window` samples at some steps, (length, channel) float64.

    Args:
        values: (step, channel) samples of a recording; at its start the average is over those there are.
        window: samples; 0 and 1 average nothing.
        first: first step that is returned.
        length: steps that are returned.
    """
    if window <= 1:
        return values[first : first + length].astype(np.float64)
    begin = max(0, first - window + 1)
    total = np.zeros((first + length - begin + 1, values.shape[1]))
    np.cumsum(values[begin : first + length], axis=0, dtype=np.float64, out=total[1:])
    end = np.arange(first, first + length) + 1 - begin
    start = np.maximum(end - window, 0)
    return np.asarray((total[end] - total[start]) / (end - start)[:, None])


class RunningAverage:
    """`moving_average` sample by sample, from a recording's first on."""

    def __init__(self, window: int, n_in: int) -> None:
        self._totals = deque([np.zeros(n_in)], maxlen=max(window, 1) + 1)
        self._window = window

    def step(self, values: Floats) -> Floats:
        """Return the mean of the last samples, (channel,) float64, given the next one."""
        if self._window <= 1:
            return values.astype(np.float64)
        self._totals.append(self._totals[-1] + values)
        return np.asarray((self._totals[-1] - self._totals[0]) / (len(self._totals) - 1))
