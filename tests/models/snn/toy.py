"""A small task that networks learn at once, and how tests train on it."""

from functools import partial

import numpy as np

from dse.base import seeds
from dse.base.records import Dataset
from dse.models.training import Training
from dse.testing.small import spikes_of
from tests.saved_data import in_a_row

SHORT = Training(epochs=4, batch_size=9, learning_rate=0.1, dropout=0.2, average_epochs=3)


def rngs(repeat=0):
    return partial(lambda purpose, *index: seeds.generator(1, {}, purpose, repeat, *index))


def fit(data, model, training, own):
    return model.fit(data, training, own)


def toy(n_channels=12, n_steps=40, n=60, rate=0.3, margin=0):
    """Return three classes told apart by which third of the channels fires more."""
    rng = np.random.default_rng(11)
    target = np.arange(n) % 3
    share = np.full((n, n_channels), rate / 4)
    for i in range(n):
        third = n_channels // 3
        share[i, target[i] * third : (target[i] + 1) * third] = rate
    x = rng.random((n, n_steps + 2 * margin, n_channels)) < share[:, None]
    start = np.full(n, margin, np.int32)
    order = rng.permutation(n)
    return Dataset(
        spikes_of(x, 5.0),
        target.astype(np.int64),
        ("a", "b", "c"),
        start,
        start - margin,
        start + margin,
        n_steps,
        np.sort(order[: n // 2]),
        np.sort(order[n // 2 :]),
        np.zeros(0, np.int64),
        in_a_row(n_channels),
    )


def accuracy(outcome, data):
    label = outcome.validation.output.sum(axis=1, dtype=np.int64).argmax(axis=1)
    return float((label == data.target[data.validation]).mean())
