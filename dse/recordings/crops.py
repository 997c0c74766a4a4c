"""Crops of training recordings as samples of their own, for families that draw no crops."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dse.records import Dataset, Ints, Spikes


def crop_starts(low: int, high: int, n: int) -> Ints:
    """Return at most n first steps, evenly spaced from the lowest to the highest, rising and distinct."""
    return np.unique(np.rint(np.linspace(low, high, n)).astype(np.int64))


def with_crops(data: Dataset, n: int) -> Dataset:
    """Return a data set that trains on up to n windows of each training recording, as samples of their own.

    The windows are evenly spaced over the range of training windows, and are appended to the samples, those
    of a recording one after the other. With n = 1 the data set is returned as it is.

    Args:
        data: a data set.
        n: windows per training recording; fewer where their range has fewer steps.
    """
    if n == 1:
        return data
    starts = [crop_starts(int(data.start_low[i]), int(data.start_high[i]), n) for i in data.train]
    source = np.repeat(data.train, [len(x) for x in starts])
    begin = np.concatenate([np.zeros(0, np.int64), *starts])
    more = len(source)
    zeros = np.zeros(more, np.int32)
    room = None if data.room_low is None else np.concatenate([data.room_low, zeros])
    room_high = None if data.room_high is None else np.concatenate([data.room_high, zeros])
    return replace(
        data,
        spikes=_appended(data.spikes, source, begin, data.n_steps),
        target=np.concatenate([data.target, data.target[source]]),
        start=np.concatenate([data.start, zeros]),
        start_low=np.concatenate([data.start_low, zeros]),
        start_high=np.concatenate([data.start_high, zeros]),
        train=len(data.target) + np.arange(more),
        room_low=room,
        room_high=room_high,
    )


def _appended(spikes: Spikes, samples: Ints, first: Ints, n_steps: int) -> Spikes:
    """Return spikes with windows of some samples as further samples, whose remaining steps are empty.

    Args:
        spikes: stored spikes.
        samples: (m,) sample numbers.
        first: (m,) first step of each window.
        n_steps: length of the windows.
    """
    begin = (samples * spikes.n_steps + first)[:, None] + np.arange(n_steps + 1)
    borders = spikes.row_offsets[begin]
    ends = np.repeat((borders[:, -1] - borders[:, 0])[:, None], spikes.n_steps, axis=1)
    ends[:, :n_steps] = borders[:, 1:] - borders[:, :1]
    before = np.cumsum(ends[:, -1]) - ends[:, -1] + spikes.row_offsets[-1]
    index = np.concatenate([np.zeros(0, np.int64), *(np.arange(a[0], a[-1]) for a in borders)])
    t_us = None
    if spikes.t_us is not None:
        since = np.repeat(np.rint(first * spikes.step_ms * 1000).astype(np.int64), ends[:, -1])
        t_us = np.concatenate([spikes.t_us, (spikes.t_us[index] - since).astype(spikes.t_us.dtype)])
    return replace(
        spikes,
        row_offsets=np.concatenate([spikes.row_offsets, (ends + before[:, None]).ravel()]),
        channel=np.concatenate([spikes.channel, spikes.channel[index]]),
        t_us=t_us,
    )
