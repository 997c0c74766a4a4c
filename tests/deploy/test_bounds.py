"""No state leaves its bounds, and the worst input comes near them."""

import numpy as np
import pytest

from dse.deploy.bounds import bounds
from dse.engine.neurons import cuba_lif, resonator
from dse.engine.neurons.calculus import NumpyCalculus


def peaks(weights, population, inputs):
    """Return the largest magnitudes of both states, before resets, over (step, input) spikes."""
    calculus = NumpyCalculus("integer")
    state = population.initial_state((weights.shape[1],), calculus)
    first, second = 0.0, 0.0
    for row in inputs:
        state, potential, _ = population.step(state, row @ weights / 32, calculus)
        first = max(first, float(np.abs(state[0]).max()))
        second = max(second, float(np.abs(potential).max()) * 4096, float(np.abs(state[1]).max()))
    return first, second


@pytest.mark.parametrize("decay_current", [0, 1, 1024, 4096])
@pytest.mark.parametrize("decay_voltage", [0, 123, 4096])
def test_inhibition_reaches_and_never_passes_the_bounds(decay_current, decay_voltage):
    weights = np.array([[-128], [-7], [90]])
    population = cuba_lif.Population(np.array([decay_current]), np.array([decay_voltage]), 80)
    most = bounds(weights, population, 200)
    first, second = peaks(weights, population, np.tile([1, 1, 0], (200, 1)))
    assert 0.6 * most.first <= first <= most.first
    assert 0.4 * most.second <= second <= most.second


def test_random_inputs_stay_within():
    rng = np.random.default_rng(3)
    n = 30
    c, s = resonator.factors(rng.uniform(2, 40, n), rng.uniform(0.5, 30, n))
    turns = rng.random(n) < 0.5
    population = resonator.Population(
        resonates=turns,
        cosine=np.where(turns, c, 0),
        sine=np.where(turns, s, 0),
        decay_current=rng.integers(0, 4097, n),
        decay_voltage=rng.integers(0, 4097, n),
        threshold=320,
        reset=False,
    )
    weights = rng.integers(-128, 128, (12, n))
    most = bounds(weights, population, 150)
    for rate in (0.1, 0.5, 1.0):
        first, second = peaks(weights, population, (rng.random((150, 12)) < rate).astype(np.int64))
        assert first <= most.first and second <= most.second
