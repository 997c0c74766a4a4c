"""Augmentation: every batch of training shows the windows of its samples in other ways."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from dse.base.records import Dataset, Floats, Ints, Spikes
from dse.engine.augment import Shifts, Windows, changed, shifts_of
from dse.models.training import Generators, Training


class Augmentation:
    """What `training` asks of the samples of a data set; each kind of change draws from its own generator.

    Samples are joined, then stretched, then moved over the array, then thinned.
    """

    def __init__(self, dataset: Dataset, training: Training, shared: Generators) -> None:
        self._dataset, self._training = dataset, training
        names = ("blend", "dilation", "channel shift", "event dropout")
        self.draws = {name: shared(name) for name in names}

    def batch(self, samples: Ints, start: Ints) -> Spikes:
        """Return the changed windows of some training samples, as samples in their order.

        Args:
            samples: (n,) sample numbers.
            start: (n,) first step of each window.
        """
        data, n = self._dataset, len(samples)
        windows = self._windows(samples, start)
        others, cut = self._others(samples, windows)
        n_shifts = len(self._shifts.to)
        return changed(
            data.spikes,
            windows,
            others,
            cut,
            self._factors(n),
            self.draws["channel shift"].integers(n_shifts, size=n) if n_shifts > 1 else np.zeros(n, int),
            self._shifts,
            data.n_steps,
            self._training.event_dropout,
            self.draws["event dropout"],
        )

    def _windows(self, samples: Ints, start: Ints) -> Windows:
        """Return windows that show what training windows of these samples may show."""
        low, high = self._dataset.start_low[samples], self._dataset.start_high[samples]
        columns = (samples, start, low, high + self._dataset.n_steps)
        return Windows(*(column.astype(np.int64) for column in columns))

    def _others(self, samples: Ints, windows: Windows) -> tuple[Windows, Ints]:
        """Return windows of the same classes, and the step from which each is shown; (n,) n_steps: never."""
        data, share, rng = self._dataset, self._training.blend, self.draws["blend"]
        never = np.full(len(samples), data.n_steps)
        if not share:
            return windows, never
        order, first, size = self._by_class
        of_class = data.target[samples]
        drawn = (rng.random(len(samples)) * size[of_class]).astype(np.int64)
        partners = order[first[of_class] + drawn]
        starts = rng.integers(data.start_low[partners], data.start_high[partners], endpoint=True)
        is_blended = rng.random(len(samples)) < share
        cut = rng.integers(1, max(2, data.n_steps), size=len(samples))
        return self._windows(partners, starts), np.where(is_blended, cut, never)

    def _factors(self, n: int) -> Floats:
        low, high = self._training.dilation
        return self.draws["dilation"].uniform(low, high, n) if low < high else np.full(n, low)

    @cached_property
    def _by_class(self) -> tuple[Ints, Ints, Ints]:
        """Training samples in the order of their classes, the first of each class, and their number."""
        train = self._dataset.train
        of_class = self._dataset.target[train]
        size = np.bincount(of_class, minlength=len(self._dataset.classes))
        return train[np.argsort(of_class, kind="stable")], np.cumsum(size) - size, size

    @cached_property
    def _shifts(self) -> Shifts:
        return shifts_of(self._dataset.positions, self._training.channel_shift)
