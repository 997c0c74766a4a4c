import math

import numpy as np
import pytest

from dse.skyline.posterior import expected, posterior_samples


def most_likely(accuracy, n, number):
    """Return what `expected` does, level by level: 20 steps from an even prior."""
    levels = [(k + 0.5) / 1000 for k in range(1000)]
    prior = [1 / 1000] * 1000
    likelihood = [
        [math.exp(m * (a * math.log(x / a) + (1 - a) * math.log((1 - x) / (1 - a)))) for x in levels]
        for a, m in zip(accuracy, n, strict=True)
    ]
    for step in range(21):
        posterior = [[x * p for x, p in zip(row, prior, strict=True)] for row in likelihood]
        posterior = [[x / sum(row) for x in row] for row in posterior]
        if step < 20:
            weighted = [[w * x for x in row] for w, row in zip(number, posterior, strict=True)]
            prior = [sum(column) / sum(number) for column in zip(*weighted, strict=True)]
    return [sum(x * p for x, p in zip(levels, row, strict=True)) for row in posterior]


def test_expected_accuracies_are_those_of_the_definition():
    accuracy, n, number = [0.9, 0.6, 0.7], [40.0, 40.0, 100.0], [1.0, 3.0, 2.0]
    found = expected(np.array(accuracy), np.array(n), np.array(number))
    assert found == pytest.approx(most_likely(accuracy, n, number), rel=1e-9)
    assert 0.6 < found[1] < found[2] < found[0] < 0.9  # towards each other


def test_luck_of_the_best_of_many_is_taken_off_and_all_right_stays_a_number():
    rng = np.random.default_rng(4)
    accuracy = rng.binomial(50, 0.8, 200) / 50
    found = expected(accuracy, np.full(200, 50.0), np.ones(200))
    assert accuracy.max() > 0.9 and found.max() < 0.84 and found.min() > 0.76
    assert 0.9 < expected(np.ones(1), np.array([20.0]), np.ones(1))[0] < 1


def test_accuracies_on_a_trend_of_the_ranks_of_costs_are_known_whatever_the_errors():
    rng = np.random.default_rng(5)
    costs = np.column_stack([rng.permutation(20) ** 2, rng.permutation(20)]).astype(float)
    ranks = np.column_stack([costs[:, 0] ** 0.5, costs[:, 1]]) / 19 - 0.5
    accuracy = 0.8 + ranks @ [0.1, -0.05] + ranks**2 @ [-0.1, 0.02]
    errors = rng.normal(0, 0.1, (10, 20))
    samples = posterior_samples(accuracy, costs, np.arange(20), errors, rng)
    np.testing.assert_allclose(samples, np.tile(accuracy, (10, 1)), atol=1e-9)


def test_accuracies_without_errors_are_true():
    rng = np.random.default_rng(0)
    accuracy, costs = rng.random(12), rng.random((12, 2))
    samples = posterior_samples(accuracy, costs, np.arange(12), np.zeros((5, 12)), rng)
    np.testing.assert_allclose(samples, np.tile(accuracy, (5, 1)), atol=1e-12)


def test_too_few_trials_for_a_trend_vary_as_resampled():
    errors = np.array([[0.1, -0.1], [-0.1, 0.1]])
    samples = posterior_samples(
        np.array([0.8, 0.9]), np.zeros((2, 1)), np.arange(2), errors, np.random.default_rng(0)
    )
    np.testing.assert_allclose(samples, [[0.7, 1.0], [0.9, 0.8]])


def test_luck_is_shrunk_by_half_where_errors_are_all_there_is():
    rng = np.random.default_rng(1)
    accuracy = 0.8 + rng.normal(0, 0.02, 150)
    errors = rng.normal(0, 0.02, (300, 150))
    samples = posterior_samples(accuracy, np.zeros((150, 0)), np.arange(150), errors, rng)
    slope = np.polyfit(accuracy, samples.mean(axis=0), 1)[0]
    assert 0.35 < slope < 0.65
    assert 0.012 < samples.std(axis=0).mean() < 0.016  # 0.02 / sqrt(2)


def test_points_of_a_trial_keep_their_differences():
    rng = np.random.default_rng(2)
    of_trial = 0.8 + rng.normal(0, 0.02, 30)
    accuracy, trial = np.add.outer(of_trial, [0.0, 0.05]).ravel(), np.repeat(np.arange(30), 2)
    errors = np.repeat(rng.normal(0, 0.02, (50, 30)), 2, axis=1)
    samples = posterior_samples(accuracy, np.tile([[1.0], [2.0]], (30, 1)), trial, errors, rng)
    np.testing.assert_allclose(samples[:, 1::2] - samples[:, ::2], 0.05)


def test_errors_that_all_trials_share_decide_nothing():
    rng = np.random.default_rng(3)
    accuracy = rng.random(20)
    errors = np.repeat(rng.normal(0, 0.1, (40, 1)), 20, axis=1)
    samples = posterior_samples(accuracy, rng.random((20, 1)), np.arange(20), errors, rng)
    assert (samples.argsort(axis=1) == accuracy.argsort()).mean() > 0.9
