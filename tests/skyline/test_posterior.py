import numpy as np

from dse.skyline.posterior import posterior_samples


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
