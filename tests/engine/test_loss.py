"""The SpikeRate loss by hand and against finite differences."""

from __future__ import annotations

import numpy as np
import pytest

from dse.engine.loss import spike_rate


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
