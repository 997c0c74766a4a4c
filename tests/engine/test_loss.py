"""The SpikeRate loss by hand and against finite differences."""

from __future__ import annotations

import numpy as np
import pytest

from dse.engine.loss import n_correct, spike_rate


def test_loss_of_a_counted_example() -> None:
    counts = np.array([[2, 0]])  # of 4 steps: rates 0.5 and 0
    loss, grad = spike_rate(counts, 4, np.array([1]), true_rate=0.9, false_rate=0.1)
    assert loss == pytest.approx(0.4**2 + 0.9**2)
    np.testing.assert_allclose(grad, [[2 / 4 * 0.4, 2 / 4 * -0.9]])


def test_gradient_is_the_slope_of_the_loss() -> None:
    rng = np.random.default_rng(0)
    counts, labels = 5 * rng.random((3, 4)), np.array([0, 3, 1])
    loss, grad = spike_rate(counts, 5, labels, 0.8, 0.02)
    for _ in range(10):
        n, c = rng.integers(3), rng.integers(4)
        moved = counts.copy()
        moved[n, c] += 1e-6
        assert (spike_rate(moved, 5, labels, 0.8, 0.02)[0] - loss) / 1e-6 == pytest.approx(
            grad[n, c], rel=1e-4
        )


def test_each_head_has_a_label_of_its_own() -> None:
    counts = np.array([[2, 0, 4]])  # outputs 0 and 1 are one head, 2 and 3 would be another
    loss, grad = spike_rate(counts, 4, np.array([[1, 2]]), true_rate=0.9, false_rate=0.1)
    assert loss == pytest.approx(0.4**2 + 0.9**2 + 0.1**2)
    np.testing.assert_allclose(grad, [[2 / 4 * 0.4, 2 / 4 * -0.9, 2 / 4 * 0.1]])


def test_a_column_of_labels_is_one_head() -> None:
    rng = np.random.default_rng(1)
    counts, labels = rng.integers(0, 5, (6, 4)), rng.integers(0, 4, 6)
    flat, column = (spike_rate(counts, 5, x, 0.8, 0.02) for x in (labels, labels[:, None]))
    assert flat[0] == column[0]
    np.testing.assert_array_equal(flat[1], column[1])


def test_a_sample_is_correct_where_every_head_is() -> None:
    counts = np.array([[3, 1, 0, 2, 2], [3, 1, 9, 0, 4], [0, 5, 1, 1, 0]])
    assert n_correct(counts, np.array([0, 2, 1])) == 3
    heads = (2, 3)  # most active: 0 and 3 (a tie), 0 and 2, 1 and 2 (a tie)
    assert n_correct(counts, np.array([[0, 3], [0, 2], [1, 2]]), heads) == 3
    assert n_correct(counts, np.array([[0, 4], [1, 2], [1, 3]]), heads) == 0
    assert n_correct(counts[:0], np.zeros((0, 2), np.int64), heads) == 0
