"""Ridge classifiers against those of scikit-learn, and against leaving out each sample."""

import numpy as np
import pytest
from sklearn.linear_model import Ridge, RidgeClassifierCV

from dse.models.counts.ridge import _ALPHAS, ridge


def drawn(n, p, classes, seed=0):
    rng = np.random.default_rng(seed)
    target = np.arange(n) % classes
    return rng.normal(size=(n, p)) + 0.3 * target[:, None] * rng.normal(size=p), target


@pytest.mark.parametrize(("n", "p", "classes"), [(50, 300, 3), (300, 40, 5), (40, 10, 2), (30, 100, 2)])
def test_weights_are_those_of_scikit_learn_but_for_a_scale(n, p, classes):
    x, target = drawn(n, p, classes)
    weight, bias = ridge(x, target)
    mean, scale = x.mean(axis=0), x.std(axis=0)
    other = RidgeClassifierCV(alphas=_ALPHAS).fit((x - mean) / scale, target)
    theirs = np.atleast_2d(other.coef_).T / scale[:, None]
    ratio = weight / theirs
    assert ratio.min() > 0 and np.allclose(ratio, ratio[0, 0], rtol=1e-6)
    assert np.allclose(bias, (other.intercept_ - mean @ theirs) * ratio[0, 0], rtol=1e-6)


def test_the_penalty_is_that_of_least_error_on_samples_left_out():
    x, target = drawn(40, 10, 2)
    z, y = (x - x.mean(axis=0)) / x.std(axis=0), 2.0 * target - 1
    errors = []
    for alpha in _ALPHAS:
        rests = [np.arange(40) != i for i in range(40)]
        found = [Ridge(alpha=alpha).fit(z[k], y[k]).predict(z[~k])[0] for k in rests]
        errors.append(((np.array(found) - y) ** 2).sum())
    best = Ridge(alpha=_ALPHAS[int(np.argmin(errors))]).fit(z, y)
    ratio = ridge(x, target)[0][:, 0] * x.std(axis=0) / best.coef_
    assert np.allclose(ratio, ratio[0])


def test_outputs_are_as_sure_as_they_are_right():
    """Of inputs that tell nothing, no class is likely; of inputs that tell it, the class is."""
    noise = np.random.default_rng(1).normal(size=(90, 4))
    target = np.arange(90) % 3
    for x, least, most in ((noise, 0.3, 0.5), (noise + 9 * np.eye(3, 4)[target], 0.99, 1.0)):
        weight, bias = ridge(x, target)
        odds = x @ weight + bias
        chance = np.exp(odds - odds.max(axis=1, keepdims=True))
        assert least < (chance.max(axis=1) / chance.sum(axis=1)).mean() <= most


@pytest.mark.parametrize("x", [np.zeros((4, 3)), np.repeat(np.eye(2), 2, axis=0) * 1e12])
def test_constant_and_huge_inputs(x):
    weight, bias = ridge(x, np.array([0, 0, 1, 1]))
    assert np.isfinite(weight).all() and np.isfinite(bias).all()
