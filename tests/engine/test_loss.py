"""Losses by hand, against finite differences of their definition, and at their limits."""

import numpy as np
import pytest

from dse.engine.goal import Goal, by_spike, n_correct
from dse.engine.losses.count_cross_entropy import CountCrossEntropy
from dse.engine.losses.spike_rate import SpikeRate


def test_spike_rate_of_a_counted_example():
    goal = Goal(SpikeRate(), 0.9, 0.1)
    counts = np.array([[[2, 0]]])  # of 4 steps: rates 0.5 and 0
    loss, by_count = goal.loss.gradient(counts, goal.outputs(np.array([1]), 4, 2))
    assert loss == pytest.approx(0.4**2 + 0.9**2)
    np.testing.assert_allclose(by_count, [[[2 / 4 * 0.4, 2 / 4 * -0.9]]])


def test_each_head_has_a_label_of_its_own():
    counts = np.array([[[2, 0, 4]]])
    goal = Goal(SpikeRate(), 0.9, 0.1, (2, 1))
    loss, by_count = goal.loss.gradient(counts, goal.outputs(np.array([[1, 2]]), 4, 3))
    assert loss == pytest.approx(0.4**2 + 0.9**2 + 0.1**2)
    np.testing.assert_allclose(by_count, [[[2 / 4 * 0.4, 2 / 4 * -0.9, 2 / 4 * 0.1]]])
    both = Goal(CountCrossEntropy(), 0.9, 0.1, (2, 1))
    loss, by_count = both.loss.gradient(counts, both.outputs(np.array([[1, 2]]), 4, 3))
    p = 1 / (1 + np.exp(-0.15 * 2))  # of output 0; a head of one class says nothing
    assert loss == pytest.approx(-np.log(1 - p))
    np.testing.assert_allclose(by_count, [[[0.15 * p, -0.15 * p, 0.0]]])


def test_a_column_of_labels_is_one_head():
    rng = np.random.default_rng(1)
    counts, labels = rng.integers(0, 5, (6, 1, 4)), rng.integers(0, 4, 6)
    goal = Goal(SpikeRate(), 0.8, 0.02)
    flat, column = (goal.loss.gradient(counts, goal.outputs(x, 5, 4)) for x in (labels, labels[:, None]))
    assert flat[0] == column[0]
    np.testing.assert_array_equal(flat[1], column[1])


def test_cross_entropy_of_a_counted_example():
    goal = Goal(CountCrossEntropy(count_scale=np.log(2)), 0.9, 0.1)
    counts = np.array([[[1, 0, 0]]])  # odds 2 : 1 : 1
    loss, by_count = goal.loss.gradient(counts, goal.outputs(np.array([1]), 4, 3))
    assert loss == pytest.approx(np.log(4))
    np.testing.assert_allclose(by_count, np.log(2) * np.array([[[0.5, -0.75, 0.25]]]))


def test_read_outs_are_evenly_spaced_and_each_length_counts_once():
    assert CountCrossEntropy(read_outs=1).lengths(128) == (128,)
    assert CountCrossEntropy(read_outs=4).lengths(128) == (32, 64, 96, 128)
    assert CountCrossEntropy(read_outs=3).lengths(4) == (2, 3, 4)
    assert CountCrossEntropy(read_outs=9).lengths(2) == (1, 2)


def test_a_spike_counts_at_every_length_after_it():
    by_count = np.array([[[1.0, 10.0], [2.0, 20.0], [4.0, 40.0]]])
    np.testing.assert_array_equal(by_spike(by_count), [[[7, 70], [6, 60], [4, 40]]])
    np.testing.assert_array_equal(by_spike(by_count[:, :1]), by_count[:, :1])


@pytest.mark.parametrize("counts", [0, 10**7], ids=["silence", "huge ties"])
def test_cross_entropy_of_ties_is_that_of_chance(counts):
    goal = Goal(CountCrossEntropy(read_outs=2), 0.9, 0.1)
    outputs = goal.outputs(np.array([2]), 8, 4)
    loss, by_count = goal.loss.gradient(np.full((1, 2, 4), counts), outputs)
    assert loss == pytest.approx(np.log(4), rel=1e-6)
    np.testing.assert_allclose(by_count, np.tile(0.15 / 2 * np.array([0.25, 0.25, -0.75, 0.25]), (1, 2, 1)))


def test_cross_entropy_of_huge_counts_is_finite():
    goal = Goal(CountCrossEntropy(), 0.9, 0.1)
    counts = np.array([[[10**8, 0]]])
    wrong, by_count = goal.loss.gradient(counts, goal.outputs(np.array([1]), 8, 2))
    assert wrong == pytest.approx(0.15 * 1e8)
    np.testing.assert_allclose(by_count, [[[0.15, -0.15]]])
    right, by_count = goal.loss.gradient(counts, goal.outputs(np.array([0]), 8, 2))
    assert right == 0 and not by_count.any()


def test_probabilities_in_place_of_labels_by_hand():
    soft = np.array([[0.75, 0.25]])
    rate = Goal(SpikeRate(), 0.9, 0.1)
    loss, by_count = rate.loss.gradient(np.array([[[2, 0]]]), rate.outputs(np.array([0]), 4, 2, soft))
    assert loss == pytest.approx((0.5 - 0.7) ** 2 + 0.3**2)
    np.testing.assert_allclose(by_count, [[[2 / 4 * -0.2, 2 / 4 * -0.3]]])
    entropy = Goal(CountCrossEntropy(count_scale=np.log(3)), 0.9, 0.1)
    loss, by_count = entropy.loss.gradient(np.array([[[1, 0]]]), entropy.outputs(np.array([0]), 4, 2, soft))
    assert loss == pytest.approx(-0.75 * np.log(0.75) - 0.25 * np.log(0.25))
    np.testing.assert_allclose(by_count, 0, atol=1e-12)  # odds of 3 : 1 are what the teacher says


def test_a_sample_is_correct_where_every_head_is():
    counts = np.array([[3, 1, 0, 2, 2], [3, 1, 9, 0, 4], [0, 5, 1, 1, 0]])
    assert n_correct(counts, np.array([0, 2, 1])) == 3
    heads = (2, 3)  # most active: 0 and 3 (a tie), 0 and 2, 1 and 2 (a tie)
    assert n_correct(counts, np.array([[0, 3], [0, 2], [1, 2]]), heads) == 3
    assert n_correct(counts, np.array([[0, 4], [1, 2], [1, 3]]), heads) == 0
    assert n_correct(counts[:0], np.zeros((0, 2), np.int64), heads) == 0
