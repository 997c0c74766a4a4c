"""Networks with a delay per synapse: what they learn, how they are stored, and their place in a cohort."""

from dataclasses import replace

import numpy as np
import pytest

from dse.base.records import Network
from dse.engine.neurons.cuba_lif import CubaLif
from dse.engine.neurons.lif import Lif
from dse.models.snn.family import SNN
from dse.models.training import Training
from dse.testing.small import spikes_of
from tests.models.snn.toy import SHORT, accuracy, fit, rngs, toy


def lags():
    """Return classes that only the lag from one channel to the other tells apart."""
    data, rng = toy(n_channels=2, n_steps=60), np.random.default_rng(4)
    x = np.zeros((60, 60, 2), bool)
    for i, lag in enumerate(np.array([2, 9, 16])[data.target]):
        at = rng.choice(np.arange(0, 42, 3), 6, replace=False)
        x[i, at, 0] = x[i, at + lag, 1] = True
    return replace(data, spikes=spikes_of(x, 5.0))


def test_they_tell_lags_apart_that_undelayed_nets_do_not():
    data = lags()
    training = Training(epochs=30, batch_size=10, learning_rate=0.1, warmup_epochs=1, dropout=0.0)
    neuron = CubaLif(current_decay=(0.8, 1.0), voltage_decay=(0.6, 1.0))
    shared = {"hidden": (30,), "true_rate": 0.3, "output_tau_grad": 0.3, "neuron": neuron}
    late = fit(data, SNN(max_delay=20, delay_learning_rate=0.3, **shared), training, rngs())
    plain = fit(data, SNN(**shared), training, rngs())
    assert accuracy(late, data) >= accuracy(plain, data) + 0.2


def test_synapses_have_delays():
    data = toy()
    model = SNN(hidden=(10, 9), max_delay=12, delayed_layers="all", pruned=0.3)
    outcome = fit(data, model, SHORT, rngs())
    network = outcome.network
    assert isinstance(network, Network) and network.delay_bits == 4
    for layer in network.layers:
        assert layer.delay is not None and layer.delay.shape == layer.weight.shape
        assert layer.delay.dtype == np.int8 and layer.delay.min() >= 0 and layer.delay.max() <= 12
    # A spike of the input is one, whatever its delays.
    starts = data.spikes.row_offsets[data.validation * 40], data.spikes.row_offsets[data.validation * 40 + 40]
    np.testing.assert_array_equal(outcome.validation.spikes[..., 0].sum(axis=1), starts[1] - starts[0])


def test_delays_rest_while_weights_are_averaged():
    data = toy()
    model = SNN(hidden=(10,), max_delay=20, delay_learning_rate=1.0)
    delays = []
    for epochs in (SHORT.epochs, SHORT.epochs - SHORT.average_epochs):
        network = fit(data, model, replace(SHORT, epochs=epochs, average_epochs=1), rngs()).network
        delays.append(network.layers[0].delay)
        assert network.layers[1].delay is None
    assert (delays[0] != delays[1]).any()
    averaged = fit(data, model, replace(SHORT, epochs=1, average_epochs=1), rngs()).network
    fixed = fit(data, replace(model, delay_learning_rate=0), replace(SHORT, epochs=1), rngs()).network
    np.testing.assert_array_equal(averaged.layers[0].delay, fixed.layers[0].delay)


def test_keys_that_do_not_go_together():
    with pytest.raises(
        ValueError, match=r"input_delays must be \[0\] where synapses have delays .* \[0, 5\]"
    ):
        SNN(max_delay=9, input_delays=(0, 5))
    with pytest.raises(ValueError, match="max_delay must be 0 for neuron lif, which has no kernel"):
        SNN(max_delay=9, neuron=Lif(), arithmetic="ideal")
    with pytest.raises(ValueError, match="delayed_layers must be first where hidden layers are recurrent"):
        SNN(max_delay=9, recurrent=True, delayed_layers="all")
