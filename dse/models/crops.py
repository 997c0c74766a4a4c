"""Crops: several windows of each training recording, as samples of their own."""

from __future__ import annotations

import dataclasses

import numpy as np

from dse.base.records import Dataset, Ints, Outcome, Spikes
from dse.config.contracts import Family
from dse.models.training import Generators, Training


def fit_alone(family: Family, data: Dataset, training: Training, rngs: Generators) -> Outcome:
    """Train a design alone, on crops unless its family draws crops itself."""
    crops = 1 if getattr(family, "draws_crops", False) else training.crops
    return family.fit(with_crops(data, crops), training, rngs)


def crop_starts(low: int, high: int, n: int) -> Ints:
    """Return at most n first steps, evenly spaced from the lowest to the highest, rising and distinct."""
    return np.unique(np.rint(np.linspace(low, high, n)).astype(np.int64))


def with_crops(data: Dataset, n: int) -> Dataset:
    """Return a data set that trains on up to n windows of each training recording, as samples of their own.

    The windows are evenly spaced over the range of training windows, fewer where it has fewer steps, and are
    appended to the samples, those of a recording one after the other. With n = 1 the data set is as it was.
    """
    if n == 1:
        return data
    starts = [crop_starts(int(data.start_low[i]), int(data.start_high[i]), n) for i in data.train]
    source = np.repeat(data.train, [len(x) for x in starts])
    begin = np.concatenate([np.zeros(0, np.int64), *starts])
    more = len(source)
    names = ("start", "start_low", "start_high", "room_low", "room_high")
    placed = {name: getattr(data, name) for name in names}
    zeros = np.zeros(more, np.int32)
    placed = {name: np.concatenate([x, zeros]) for name, x in placed.items() if x is not None}
    return dataclasses.replace(
        data,
        spikes=_appended(data.spikes, source, begin, data.n_steps),
        target=np.concatenate([data.target, data.target[source]]),
        train=len(data.target) + np.arange(more),
        **placed,
    )


def _appended(spikes: Spikes, samples: Ints, first: Ints, n_steps: int) -> Spikes:
    """Return spikes with windows of some samples as further samples, whose remaining steps are empty.

    samples, first: (m,) sample and first step of each window.
    """
    more = spikes.pieces(samples, first, n_steps)
    counts = np.zeros((len(samples), spikes.n_steps), np.int64)
    counts[:, :n_steps] = np.diff(more.row_offsets).reshape(len(samples), n_steps)
    ends = spikes.row_offsets[-1] + np.cumsum(counts)
    t_us = None
    if spikes.t_us is not None and more.t_us is not None:
        t_us = np.concatenate([spikes.t_us, more.t_us])
    return dataclasses.replace(
        spikes,
        row_offsets=np.concatenate([spikes.row_offsets, ends]),
        channel=np.concatenate([spikes.channel, more.channel]),
        t_us=t_us,
    )
