"""Cutting windows and delayed copies out of stored spikes."""

import numpy as np
import pytest

from benchmarks.ours import rows_of
from dse.base.records import Spikes
from dse.engine.events import delayed, dense, gather, without


def stored(x):
    rows = rows_of(x)
    return Spikes(rows.offsets, rows.index, x.shape[1], x.shape[2], 1.0)


def windows(x, samples, start, n, delays, k):
    """Return the definition: each window on every k-th network step, each copy shifted within the window."""
    out = np.zeros((len(samples), n * k, x.shape[2] * len(delays)), np.uint8)
    for i, (sample, first) in enumerate(zip(samples, start, strict=True)):
        spread = np.zeros((n * k, x.shape[2]), np.uint8)
        spread[::k] = x[sample, first : first + n]
        for copy, delay in enumerate(delays):
            columns = slice(copy * x.shape[2], (copy + 1) * x.shape[2])
            out[i, delay:, columns] = spread[: max(0, n * k - delay)]
    return out


@pytest.mark.parametrize("delays", [(0,), (0, 3), (5, 1, 100)])
@pytest.mark.parametrize("k", [1, 2, 3])
def test_windows_equal_their_definition(delays, k):
    x = (np.random.default_rng(1).random((4, 20, 5)) < 0.3).astype(np.uint8)
    samples, start = [3, 0, 3], [0, 8, 4]
    rows = gather(stored(x), np.array(samples), np.array(start), 12, delays, k)
    np.testing.assert_array_equal(dense(rows), windows(x, samples, start, 12, delays, k))
    assert rows.per_step().sum() == rows.index.size


def test_a_window_outside_the_stored_steps_is_refused():
    spikes = stored(np.zeros((2, 10, 3), np.uint8))
    with pytest.raises(ValueError, match=r"must lie within the 10 stored steps"):
        gather(spikes, np.array([0]), np.array([4]), 7)


def test_delayed_spikes_lose_the_last_step_of_each_sample():
    x = (np.random.default_rng(2).random((3, 6, 4)) < 0.5).astype(np.uint8)
    expected = np.zeros_like(x)
    expected[:, 1:] = x[:, :-1]
    np.testing.assert_array_equal(dense(delayed(rows_of(x))), expected)


def test_a_silenced_channel_sends_nothing_and_neither_do_its_delayed_copies():
    rng = np.random.default_rng(3)
    x = (rng.random((3, 7, 5)) < 0.5).astype(np.uint8)
    silenced = rng.random((3, 5)) < 0.4
    rows = gather(stored(x), np.arange(3), np.zeros(3, int), 7, (0, 2))
    left = gather(stored(x * ~silenced[:, None]), np.arange(3), np.zeros(3, int), 7, (0, 2))
    np.testing.assert_array_equal(dense(without(rows, silenced)), dense(left))
    assert without(rows, np.ones((3, 5), bool)).index.size == 0
