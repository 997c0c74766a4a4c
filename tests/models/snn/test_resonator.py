"""Networks of resonators: what they learn, their names, and their place in a cohort."""

from dataclasses import replace

import numpy as np
import pytest

from dse.engine.neurons.cuba_lif import CubaLif
from dse.engine.neurons.resonator import Resonator
from dse.models.snn.family import SNN
from dse.models.training import Training
from dse.testing.small import spikes_of
from tests.models.snn.toy import SHORT, accuracy, fit, rngs, toy


def periods():
    """Return classes that only the period of their spikes tells apart: all have as many."""
    data, rng = toy(n_channels=6, n_steps=60), np.random.default_rng(4)
    x = np.zeros((60, 60, 6), bool)
    for i, period in enumerate(np.array([4, 6, 9])[data.target]):
        at = np.arange(rng.integers(period), 60, period)
        for channel in range(6):
            x[i, rng.choice(at, 6, replace=False), channel] = True
    return replace(data, spikes=spikes_of(x, 5.0))


def test_they_tell_periods_apart_that_leaky_neurons_do_not():
    data = periods()
    training = Training(epochs=25, batch_size=10, learning_rate=0.1, warmup_epochs=1, dropout=0.0)
    shared = {"hidden": (24,), "true_rate": 0.5, "output_tau_grad": 0.3, "initial_rate": 0.2}
    of = {
        type(neuron).__name__: fit(data, SNN(neuron=neuron, **shared), training, rngs())
        for neuron in (CubaLif(), Resonator(period=(3, 12)))
    }
    resonators = of["Resonator"]
    assert accuracy(resonators, data) >= 0.8 > accuracy(of["CubaLif"], data)
    assert resonators.health["missed_initial_rates"] == 0
    assert not resonators.health["overflows_24_bit"]


def test_a_period_that_the_steps_cannot_hold_ends_before_training():
    model = SNN(hidden=(10,), neuron=Resonator(period=(20, 200), period_unit="Hz"))
    with pytest.raises(ValueError, match="period must be at least 2 input steps of 5 ms, got 200 Hz"):
        fit(toy(), model, SHORT, rngs())
