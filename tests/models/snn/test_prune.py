"""Magnitude pruning: what stays, that what goes stays gone, and what that does to W_t and operations."""

import dataclasses

import numpy as np
import pytest

from dse.base.records import Spikes
from dse.engine.neurons import fixed_point
from dse.models.snn.family import SNN
from dse.models.snn.quantise import largest, remaining
from dse.models.snn.respond import fan_outs, respond_and_count
from dse.models.training import Training
from tests.models.snn.toy import SHORT, accuracy, fit, rngs, toy


def test_the_smallest_magnitudes_go_rounded_down_and_the_first_of_equal_ones():
    w = np.array([[0.5, -0.1, 2.0], [-0.1, 0.0, -3.0]])
    assert largest(w, 0.0).all()
    assert largest(w, 0.49).tolist() == [[True, False, True], [True, False, True]]
    assert largest(w, 0.5).tolist() == [[True, False, True], [False, False, True]]
    assert largest(w, 0.99).tolist() == [[False, False, False], [False, False, True]]


def test_what_8_bits_round_to_0_is_stored_as_0():
    w, kept = np.array([0.01, 0.5, -0.015, 0.02], np.float32), np.array([True, False, True, True])
    assert remaining(w, kept, "integer").tolist() == [0, 0, 0, np.float32(0.02)]
    np.testing.assert_array_equal(remaining(w, kept, "float32"), w * kept)


@pytest.mark.parametrize("arithmetic", ["integer", "float32", "ideal"])
@pytest.mark.parametrize("recurrent", [False, True])
def test_every_matrix_loses_its_share_through_all_updates_and_the_mean(arithmetic, recurrent):
    data = toy()
    model = SNN(hidden=(20, 9), arithmetic=arithmetic, recurrent=recurrent, pruned=0.8, prune_epoch=0.25)
    outcome = fit(data, model, SHORT, rngs())
    matrices = [x.weight for x in outcome.network.layers]
    matrices += [x.recurrent for x in outcome.network.layers if x.recurrent is not None]
    for w in matrices:
        removed = int((w == 0).sum())
        assert removed >= int(0.8 * w.size)
        if arithmetic == "integer":
            assert (fixed_point.quantise(w[w != 0]) != 0).all()
        else:
            assert removed == int(0.8 * w.size)
    assert outcome.network.n_weights == sum(np.count_nonzero(w) for w in matrices)
    assert outcome.health["n_weights_dense"] == outcome.network.n_weights_dense == model.n_weights(12, 3)


def test_a_pruned_network_still_learns():
    data = toy()
    model = SNN(hidden=(20,), true_rate=0.5, output_tau_grad=0.3, pruned=0.7, prune_epoch=0.4)
    outcome = fit(data, model, Training(epochs=25, batch_size=8, learning_rate=0.1, dropout=0.0), rngs())
    assert accuracy(outcome, data) >= 0.8
    assert outcome.network.n_weights <= 0.31 * outcome.network.n_weights_dense


def test_until_it_is_pruned_a_network_trains_as_if_it_never_were():
    data = toy()
    dense = fit(data, SNN(hidden=(20,)), SHORT, rngs())
    late = fit(data, SNN(hidden=(20,), pruned=0.5, prune_epoch=0.5), SHORT, rngs())
    assert late.history["loss"][:2].tolist() == dense.history["loss"][:2].tolist()
    assert late.history["loss"][2] != dense.history["loss"][2]
    assert dense.network.n_weights == dense.network.n_weights_dense
    assert dense.validation.synapses is None


def test_synapses_are_those_that_the_spikes_reach():
    data = toy()
    model = SNN(hidden=(20,), recurrent=True, input_delays=(0, 2), pruned=0.6)
    outcome = fit(data, model, SHORT, rngs())
    response, fired = respond_and_count(outcome.network, data, data.validation)
    hidden, output = outcome.network.layers
    reached = [
        (hidden.weight != 0).sum(axis=0),
        (output.weight != 0).sum(axis=0) + (hidden.recurrent != 0).sum(axis=0),
        np.zeros(3, int),
    ]
    for found, expected in zip(fan_outs(outcome.network), reached, strict=True):
        np.testing.assert_array_equal(found, expected)
    total = response.spikes.sum(axis=(0, 1), dtype=np.int64)
    assert [int(x.sum()) for x in fired] == total.tolist()
    operations = sum(int(a @ b.sum(axis=0)) for a, b in zip(reached, fired, strict=True))
    assert total @ np.array(response.synapses) == pytest.approx(operations, rel=1e-12)


def test_a_network_without_input_has_the_mean_over_its_neurons():
    data = toy()
    outcome = fit(data, SNN(hidden=(20,), pruned=0.6), SHORT, rngs())
    nothing = Spikes(np.zeros_like(data.spikes.row_offsets), np.zeros(0, np.int32), 40, 12, 5.0)
    silent = dataclasses.replace(data, spikes=nothing)
    response, _ = respond_and_count(outcome.network, silent, data.validation)
    assert response.synapses[0] == pytest.approx(np.count_nonzero(outcome.network.layers[0].weight) / 12)
