"""Small data sets for the classifiers of counts, and their random generators."""

import numpy as np

from dse.base import seeds
from dse.base.records import Dataset
from dse.testing.small import spikes_of


def rngs(purpose, *index):
    return seeds.generator(1, {}, purpose, 0, *index)


def data_of(x, target, train, validation, test=(), start=None, n_steps=None, step_ms=10.0):
    """Return a data set of dense spikes (sample, step, channel)."""
    first = np.zeros(len(x), np.int32) if start is None else np.array(start, np.int32)
    place = np.arange(x.shape[2], dtype=np.int32)
    return Dataset(
        spikes_of(x, step_ms),
        np.array(target, np.int64),
        tuple("abcdefgh"[: max(target) + 1]),
        first,
        first,
        first,
        x.shape[1] if n_steps is None else n_steps,
        *(np.array(part, np.int64) for part in (train, validation, test)),
        positions=np.stack([place, 0 * place, 0 * place], axis=1),
    )


def textures(n=60, n_steps=23, n_channels=4, n_classes=3):
    """Return classes told apart by which channel fires more, and by how much; windows begin at 0 to 2."""
    rng = np.random.default_rng(3)
    target = np.arange(n) % n_classes
    rate = np.full((n, n_channels), 0.15)
    rate[np.arange(n), target % n_channels] = 0.5
    rate += 0.15 * target[:, None]
    x = rng.random((n, n_steps + 2, n_channels)) < rate[:, None]
    order = rng.permutation(n)
    parts = np.sort(order[: n // 2]), np.sort(order[n // 2 : -6]), np.sort(order[-6:])
    return data_of(x, list(target), *parts, start=list(rng.integers(0, 3, n)), n_steps=n_steps)
