"""Gaussian naive Bayes against scikit-learn."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.models.counts.naive_bayes import NaiveBayes, log_likelihood
from dse.models.training import Training
from tests.models.counted import data_of, rngs, textures


@pytest.mark.parametrize("channels", ["sum", "each"])
@pytest.mark.parametrize("var_smoothing", [1e-9, 0.1])
def test_every_length_is_scikit_learn_on_that_length(channels, var_smoothing):
    from sklearn.naive_bayes import GaussianNB

    data = textures()
    family = NaiveBayes(window_ms=50.0, channels=channels, var_smoothing=var_smoothing)
    outcome = family.fit(data, Training(), rngs)
    counts = [family.counts(data, part, {}) for part in (data.train, data.validation)]
    for j in range(5):
        train, validation = (each[:, : j + 1].reshape(len(each), -1) for each in counts)
        known = GaussianNB(var_smoothing=var_smoothing).fit(train, data.target[data.train])
        assert np.array_equal(outcome.validation.label[:, j], known.predict(validation))
        n = train.shape[1]
        variance = outcome.network.arrays["variance"][:, :n] + outcome.network.arrays["smoothing"][j]
        assert variance == pytest.approx(known.var_, rel=1e-12)
        joint = outcome.network.arrays["log_prior"] + log_likelihood(
            validation, outcome.network.arrays["mean"][:, :n], variance
        )
        assert joint == pytest.approx(known.predict_joint_log_proba(validation), rel=1e-9)


@given(st.integers(0, 10**6))
def test_likelihood_is_that_of_the_normal_distribution(seed):
    from scipy.stats import norm

    rng = np.random.default_rng(seed)
    x, mean, variance = rng.normal(size=(3, 4)), rng.normal(size=(2, 4)), rng.uniform(0.1, 2, (2, 4))
    expected = norm.logpdf(x[:, None], mean, np.sqrt(variance)).sum(axis=2)
    assert log_likelihood(x, mean, variance) == pytest.approx(expected, rel=1e-9)


def test_by_hand():
    """Classes of 1 and 3 spikes: variance 0, plus half of the largest variance, 1."""
    x = np.zeros((6, 4, 1), bool)
    for i, n in enumerate((1, 3, 1, 3, 2, 3)):
        x[i, :n] = True
    family = NaiveBayes(window_ms=40.0, var_smoothing=0.5)
    outcome = family.fit(data_of(x, [1, 0, 1, 0, 0, 0], range(4), [4, 5]), Training(), rngs)
    arrays = outcome.network.arrays
    assert (arrays["mean"].tolist(), arrays["variance"].tolist()) == ([[3.0], [1.0]], [[0.0], [0.0]])
    assert arrays["smoothing"].tolist() == [0.5]
    assert outcome.validation.label.tolist() == [[0], [0]]  # 2 spikes are as far from both: the lowest


def test_smoothing_follows_the_input_length():
    """A late window that varies much does not smooth the answer before it."""
    x = np.zeros((8, 8, 1), bool)
    x[::2, :1] = True
    x[:4, 4:] = True
    family = NaiveBayes(window_ms=40.0, var_smoothing=0.5)
    outcome = family.fit(data_of(x, [0, 1] * 4, range(8), range(8)), Training(), rngs)
    assert outcome.network.arrays["smoothing"].tolist() == [0.125, 2.0]
