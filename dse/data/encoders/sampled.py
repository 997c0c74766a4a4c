"""What the encoders have in common: recordings one by one, copies of the channels, and smoothing."""

from __future__ import annotations

from abc import abstractmethod
from collections import deque

import numpy as np

from dse.base.records import Floats, Ints, Signals, Spikes
from dse.config.contracts import Encoder


class OneByOne(Encoder):
    """An encoder that makes copies of the channels, and encodes a recording without a look at others."""

    @abstractmethod
    def _copies(self) -> int:
        """Return the number of spike trains of each channel; a ValueError where it has yet to be learnt."""

    @abstractmethod
    def _encoded(self, signals: Signals, i: int, first: int, length: int) -> tuple[Ints, Ints]:
        """Return the spikes per step (length,) of some steps of a recording, and their channels, in order."""

    def n_channels(self, n_in: int) -> int:
        """Return the number of spike channels that n_in sampled channels become."""
        return self._copies() * n_in

    def positions(self, inputs: Ints) -> Ints:
        """Return x, y and plane of the spike channels, copy by copy; copy k of q is plane q n_copies + k."""
        copies = self._copies()
        positions = np.tile(np.asarray(inputs, dtype=np.int32), (copies, 1))
        positions[:, 2] = positions[:, 2] * copies + np.repeat(np.arange(copies, dtype=np.int32), len(inputs))
        return positions

    def encode_all(self, signals: Signals, first: Ints, length: Ints) -> Spikes:
        """Return spikes of the steps first[i] .. first[i] + length[i] - 1 of every recording."""
        n_channels, n_steps = self.n_channels(signals.n_channels), int(np.max(length))
        counts = np.zeros((signals.n_recordings, n_steps), dtype=np.int64)
        pieces = [np.zeros(0, np.int32)]
        for i in np.flatnonzero(length):
            found = self._encoded(signals, int(i), int(first[i]), int(length[i]))
            counts[i, : length[i]], channels = found
            pieces.append(channels.astype(np.int32))
        offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        return Spikes(offsets, np.concatenate(pieces), n_steps, n_channels, signals.step_ms)


def smoothed(signals: Signals, i: int, first: int, length: int, smoothing_ms: float) -> Floats:
    """Return some steps of recording i, (length, channel) float64, smoothed from its first sample on."""
    values = signals.values[signals.offsets[i] : signals.offsets[i + 1]]
    return moving_average(values, round(smoothing_ms / signals.step_ms), first, length)


def moving_average(values: Floats, window: int, first: int, length: int) -> Floats:
    """Return the mean of the last `window` samples at some steps, (length, channel) float64.

    values: (step, channel) samples of a recording; at its start the average is over those there are. Windows
    of 0 and 1 average nothing.
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
