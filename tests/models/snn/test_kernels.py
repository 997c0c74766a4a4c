"""Networks of random kernels: what a candidate adds up, what survives a reset, which weights there are."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.ours import rows_of
from dse.base import registry
from dse.engine.forward import prepare
from dse.engine.layers import weights
from dse.engine.neurons import cuba_lif
from dse.engine.neurons.cuba_lif import CubaLif
from dse.models.snn import kernels
from dse.models.snn.contrasts import Drives
from tests.models.snn.toy import SHORT, accuracy, fit, rngs, toy

LEVELS = cuba_lif.rounded(0.03, 1.0, 5.0)  # neurons that hold a level in their current
N_PLACES, N_DELAYS = 6, 4
# ON and OFF spikes of each place.
WIRING = {"place": np.tile(np.arange(N_PLACES), 2), "sign": np.repeat([-1, 1], N_PLACES)}
FAMILY = registry.known("models")["kernel_snn"]


def drives(seed=0, rate=0.2):
    n = 2 * N_PLACES * N_DELAYS
    fired = np.random.default_rng(seed).random((5, 200, n)) < rate
    return Drives(rows_of(fired.astype(np.uint8)), LEVELS, 8, np.inf, WIRING)


@given(st.integers(0, 2**31))
def test_a_kernel_is_of_few_places_and_does_not_see_a_level_that_stays(seed):
    at = drives()
    kernel = kernels.Kernels(np.array([seed]), np.array([0.1]), np.array([0]))
    inputs, shares = kernel.drive(0, at)
    of_input = np.zeros(at.n_inputs)
    of_input[at.active[inputs]] = shares / at.means[inputs]
    by_delay = of_input.reshape(N_DELAYS, 2, N_PLACES)
    np.testing.assert_allclose(by_delay[:, 0], -by_delay[:, 1])  # OFF takes back what ON adds
    np.testing.assert_allclose(by_delay.sum(axis=0), 0, atol=1e-12)
    assert 1 <= np.count_nonzero(by_delay.any(axis=(0, 1))) <= 4
    assert np.count_nonzero(by_delay.any(axis=(1, 2))) >= 2
    np.testing.assert_array_equal(kernel.drive(0, at)[1], shares)


def test_without_delayed_copies_a_kernel_is_a_level():
    fired = np.random.default_rng(0).random((3, 100, 2 * N_PLACES)) < 0.2
    at = Drives(rows_of(fired.astype(np.uint8)), LEVELS, 8, np.inf, WIRING)
    for seed in range(20):
        inputs, shares = kernels.Kernels(np.array([seed]), np.array([0.1]), np.array([0])).drive(0, at)
        np.testing.assert_allclose(np.abs(shares), at.means[inputs])
        assert inputs.size in (2, 4, 6, 8)


def test_spikes_count_the_steps_with_a_level_above_the_threshold():
    """A reset forgets nothing where the voltage decays at once."""
    at = drives()
    found = at.weights(kernels.Kernels.drawn(at.n_inputs, 40, 8, np.random.default_rng(1)))
    fired = np.random.default_rng(0).random((5, 200, at.n_inputs)) < 0.2
    drive, level = fired @ found, np.zeros((5, 40))
    above = np.zeros((5, 40), int)
    keep = 1 - LEVELS.decay_current / 4096
    for step in range(200):
        level = keep * level + drive[:, step]
        above += level >= LEVELS.to_threshold
    layer = prepare(weights(found, None, LEVELS), "float64")
    np.testing.assert_array_equal(layer.forward(rows_of(fired.astype(np.uint8))).fired.per_input(), above)
    assert 0 < above.sum() < 0.9 * above.size * 200


@pytest.fixture(scope="module")
def data():
    return replace(toy(), positions=np.stack([np.arange(12), np.zeros(12), np.zeros(12)], axis=1).astype(int))


def network(**keys):
    neuron = CubaLif(current_decay=(0.03,), voltage_decay=(1.0,), threshold=5.0)
    return FAMILY(hidden=(8,), neuron=neuron, input_delays=(0, 2, 5), whitened="output", **keys)


def test_hidden_layers_stay_and_outputs_learn(data):
    first, last = (
        fit(data, network(), replace(SHORT, epochs=n, average_epochs=1, learning_rate=0.05), rngs())
        for n in (1, 12)
    )
    np.testing.assert_array_equal(first.network.layers[0].weight, last.network.layers[0].weight)
    assert not np.array_equal(first.network.layers[1].weight, last.network.layers[1].weight)
    assert accuracy(last, data) > 0.6
    of_neuron = np.count_nonzero(last.network.layers[0].weight, axis=1)
    assert 0 < of_neuron.min() and of_neuron.max() <= 4 * 3 < 12 * 3  # four places with as many delays
    least = network().least_work(12, 3, 5.0, 40)
    assert not least.is_exact and least.load.stored == (0, 0)


def test_dropout_is_its_own_and_the_choice_is_the_same_in_a_cohort(data):
    own = SHORT.__class__(epochs=3, batch_size=9, learning_rate=0.05, dropout=0.5)
    assert network(dropout=0.0).schedule(own).dropout == 0.0 and network().schedule(own).dropout == 0.3
    assert network().schedule(own).output_epochs == 3
    alone = [fit(data, network(dropout=x), own, rngs()) for x in (0.0, 0.3)]
    assert not np.array_equal(alone[0].network.layers[1].weight, alone[1].network.layers[1].weight)
    again = fit(data, network(), own, rngs())
    np.testing.assert_array_equal(again.network.layers[1].weight, alone[1].network.layers[1].weight)
