"""Axonal delays, learnt decays and the best epoch: what a design trains, keeps, stores and refuses."""

from dataclasses import replace

import numpy as np
import pytest

from dse.engine.neurons.cuba_lif import CubaLif
from dse.engine.neurons.lif import Lif
from dse.engine.neurons.resonator import Resonator
from dse.models.snn import train
from dse.models.snn.family import SNN
from dse.models.training import FitRequest, Rung, Span, Training
from tests.models.snn.toy import SHORT, accuracy, fit, rngs, toy

PRINTED = {"max_axonal_delay": 20, "delay_learning_rate": 1.0, "learnt_decays": "neuron"}


def network_of(outcome):
    return outcome.network


def assert_same(a, b):
    for mine, other in zip(a.layers, b.layers, strict=True):
        np.testing.assert_array_equal(mine.weight, other.weight)
        np.testing.assert_array_equal(mine.delay, other.delay)
        for name, values in mine.parameters.items():
            np.testing.assert_array_equal(values, other.parameters[name])


def test_axons_have_delays_and_neurons_decays():
    outcome = fit(toy(), SNN(hidden=(10, 9), **PRINTED), replace(SHORT, average_epochs=1), rngs())
    network = network_of(outcome)
    first, second, last = network.layers
    assert first.delay is None
    for layer in (second, last):
        assert layer.delay is not None and layer.delay.shape == layer.weight.shape
        assert (layer.delay == layer.delay[:1]).all() and 0 < layer.delay.max() <= 20
    for layer in network.layers:
        decays = layer.parameters["decay_current"]
        assert len(set(decays.tolist())) > 1 and decays.min() > 0 and decays.max() < 4096


def test_decays_of_a_layer_are_one_pair():
    network = network_of(fit(toy(), SNN(hidden=(10,), learnt_decays="layer"), SHORT, rngs()))
    for layer in network.layers:
        for name, printed in (("decay_current", 1024), ("decay_voltage", 123)):
            assert len(set(layer.parameters[name].tolist())) == 1
            assert layer.parameters[name][0] != printed


def test_without_a_step_size_delays_and_decays_stay():
    settings = PRINTED | {"delay_learning_rate": 0.0, "decay_learning_rate": 0.0}
    plain = fit(toy(), SNN(hidden=(10,)), SHORT, rngs())
    resting = fit(toy(), SNN(hidden=(10,), **settings), SHORT, rngs())
    for a, b in zip(network_of(plain).layers, network_of(resting).layers, strict=True):
        np.testing.assert_array_equal(a.parameters["decay_voltage"], b.parameters["decay_voltage"])
    delay = network_of(resting).layers[1].delay
    assert delay is not None and not delay.any()  # they begin below 1
    # Delays of 0 arrive as none do; only the order of float sums in the gradients differs.
    np.testing.assert_allclose(
        network_of(plain).layers[0].weight, network_of(resting).layers[0].weight, atol=0.02
    )


BEST = Training(epochs=7, batch_size=9, learning_rate=1.0, dropout=0.2, keep="best")


def span(data, model, states, until):
    request = FitRequest(model, BEST, rngs())
    ((_, ended),) = SNN.fit_span(data, [request], rngs(), span=Span(states, until))
    return ended


def test_an_epoch_whose_states_leave_24_bits_is_kept_only_if_all_do(monkeypatch):
    data, training = toy(rate=0.15), replace(BEST, epochs=4)
    for peaks, kept in ((0, 2**23, 2**23 - 1, 0), 3), ((2**23,) * 4, 2):
        shown = iter(zip((0.5, 0.9, 0.8, 0.7), peaks, strict=True))
        monkeypatch.setattr(train, "validated", lambda *_, shown=shown: next(shown))
        outcome = fit(data, SNN(hidden=(3,), **PRINTED), training, rngs())
        assert outcome.health["epoch_kept"] == kept and outcome.history["peak_state"].tolist() == [*peaks]


def test_the_best_epoch_is_kept_the_latest_of_equal_ones():
    data = toy(rate=0.15)
    outcome = fit(data, SNN(hidden=(3,), **PRINTED), BEST, rngs())
    curve = outcome.history["accuracy_validation"]
    kept = int(outcome.health["epoch_kept"])
    assert len(curve) == 7 and curve[kept - 1] == curve.max() == accuracy(outcome, data)
    assert (curve[kept:] < curve.max()).all()
    assert 1 < kept < 7  # this training ends with another epoch than its best
    last = fit(data, SNN(hidden=(3,), **PRINTED), replace(BEST, keep="last"), rngs())
    assert last.health["epoch_kept"] == 7
    assert "accuracy_validation" not in last.history
    # It is the network that the training had then.
    stopped = span(data, SNN(hidden=(3,), **PRINTED), [], kept)
    assert isinstance(stopped, Rung) and stopped.outcome is not None
    assert_same(network_of(outcome), network_of(stopped.outcome))


def test_a_training_that_pauses_after_its_best_epoch_ends_with_the_same_bits():
    data, model = toy(rate=0.15), SNN(hidden=(3,), **PRINTED)
    whole = fit(data, model, BEST, rngs())
    kept = int(whole.health["epoch_kept"])
    for until in (kept - 1, kept, 6):
        paused = span(data, model, [], until)
        assert isinstance(paused, Rung) and paused.outcome is not None
        assert paused.outcome.health["epoch_kept"] <= until
        ended = span(data, model, [lambda paused=paused: paused.state], None)
        assert ended.health["epoch_kept"] == kept
        assert_same(network_of(ended), network_of(whole))


def test_an_epoch_before_the_pruning_is_not_kept():
    model = SNN(hidden=(6,), pruned=0.9, prune_epoch=0.75)
    outcome = fit(toy(), model, BEST, rngs())
    assert outcome.health["epoch_kept"] > int(0.75 * 7)
    assert network_of(outcome).n_weights < 0.2 * network_of(outcome).n_weights_dense


def test_a_start_by_fan_in_is_drawn_as_torch_draws():
    training = replace(SHORT, epochs=1, average_epochs=1, learning_rate=1e-9)
    for scale in (1.0, 2.0):
        model = SNN(hidden=(40,), start="fan_in", weight_scale=scale, recurrent=True)
        outcome = fit(toy(n_channels=300), model, training, rngs())
        first, last = network_of(outcome).layers
        assert first.recurrent is not None
        for weights, n_inputs in ((first.weight, 300), (last.weight, 40), (first.recurrent, 40)):
            bound = scale / np.sqrt(n_inputs)
            assert 0.95 * bound < np.abs(weights).max() <= 1.001 * bound
            assert np.std(weights) == pytest.approx(bound / np.sqrt(3), rel=0.1)
        assert outcome.health["missed_initial_rates"] == 0  # there are no targets


def test_what_is_not_possible_is_said_in_a_line():
    without = replace(toy(), validation=np.zeros(0, np.int64))
    with pytest.raises(ValueError, match=r"training.keep must be last where no sample validates, got best"):
        fit(without, SNN(hidden=(6,)), BEST, rngs())
    with pytest.raises(ValueError, match=r"average_epochs must be 1 where the best epoch is kept .* got 3"):
        Training(keep="best", average_epochs=3)
    with pytest.raises(ValueError, match=r"max_axonal_delay must be 0 where synapses have delays .* got 5"):
        SNN(max_delay=9, max_axonal_delay=5)
    with pytest.raises(ValueError, match="max_axonal_delay must be 0 for neuron lif, which has no kernel"):
        SNN(max_axonal_delay=9, neuron=Lif(), arithmetic="ideal")
    with pytest.raises(ValueError, match="max_axonal_delay must be 0 where hidden layers are recurrent"):
        SNN(max_axonal_delay=9, recurrent=True)
    with pytest.raises(ValueError, match="learnt_decays must be no for neuron lif"):
        SNN(learnt_decays="layer", neuron=Lif(), arithmetic="ideal")
    with pytest.raises(ValueError, match="learnt_decays must be no for neuron resonator"):
        SNN(learnt_decays="neuron", neuron=Resonator())
    with pytest.raises(ValueError, match="start must be uniform or contrasts where channels share weights"):
        SNN(start="fan_in", regions=12)
    assert SNN(learnt_decays="neuron", neuron=CubaLif(current_decay=(0.1, 0.9)))
