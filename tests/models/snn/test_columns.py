"""Columns: which synapses share a weight, hard arrays of taxels, training alone and in cohorts."""

from dataclasses import replace

import numpy as np
import pytest

from dse.base.records import Layer
from dse.config.contracts import placed
from dse.engine.neurons.resonator import Resonator
from dse.models.snn.columns import Columns, nearest, of_columns, of_features, repeated, taxels
from dse.models.snn.respond import respond
from tests.models.snn.toy import SHORT, rngs, toy

GRID = np.array([(x, y, p) for p in (0, 1) for y in (0, 1) for x in (0, 1, 2)], np.int32)
"""3 x 2 taxels with two planes."""


def data(positions=GRID):
    return replace(toy(n_channels=len(positions), n=30), positions=positions)


def test_neighbours_are_ordered_by_distance_then_y_then_x():
    places = taxels(GRID)
    np.testing.assert_array_equal(places, [(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1)])
    np.testing.assert_array_equal(
        nearest(places, 3),
        [(0, 1, 3, 4), (1, 0, 2, 4), (2, 1, 5, 4), (3, 0, 4, 1), (4, 1, 3, 5), (5, 2, 4, 1)],
    )
    np.testing.assert_array_equal(nearest(places, 0)[:, 0], range(6))
    assert nearest(places, 99).shape == (6, 6)


def test_columns_number_their_inputs_by_delay_rank_and_plane():
    number = of_columns(GRID, 2, 1)
    expected = np.full((24, 6), -1)
    for column, (own, next_one) in enumerate(nearest(taxels(GRID), 1)):
        for delay in (0, 1):
            for plane in (0, 1):
                expected[12 * delay + 6 * plane + own, column] = 4 * delay + plane
                expected[12 * delay + 6 * plane + next_one, column] = 4 * delay + 2 + plane
    np.testing.assert_array_equal(number, expected)
    features = of_features(number, 3)
    np.testing.assert_array_equal(features[6, :9], [3, 4, 5, 9, 10, 11, -1, -1, -1])
    assert features.shape == (24, 18)
    np.testing.assert_array_equal(repeated(2, 2, 3), [[0, 1, 2], [3, 4, 5]] * 2)


@pytest.mark.parametrize(
    ("positions", "neighbours", "n_inputs"),
    [
        ([(4, 7, 0), (4, 7, 2)], 8, 2),  # one taxel
        ([(0, 0, 0), (9, 9, 0)], 8, 2),  # fewer taxels than neighbours
        ([(0, 0, 0), (0, 0, 1), (1, 0, 1), (5, 0, 0)], 1, 4),  # taxels that lack a plane
        ([(0, 0, 0), (1, 0, 1)], 0, 2),  # no column has both planes
        ([(0, 0, 0), (0, 0, 1), (1, 0, 0)], 1, 4),
    ],
)
@pytest.mark.parametrize("read_out", ["dense", "shared"])
def test_hard_arrays_train_and_count_their_weights(positions, neighbours, n_inputs, read_out):
    positions = np.array(positions, np.int32)
    number = of_columns(positions, 1, neighbours)
    np.testing.assert_array_equal(np.unique(number[number >= 0]), range(n_inputs))
    model = Columns(features=5, neighbours=neighbours, read_out=read_out)
    of = data(positions)
    of = replace(of, spikes=toy(n_channels=len(positions), n=30).spikes)
    outcome = model.fit(of, SHORT, rngs())
    n_taxels = len(taxels(positions))
    expected = 5 * n_inputs + 5 * 3 * (1 if read_out == "shared" else n_taxels)
    assert placed(model, positions).n_weights(len(positions), 3) == expected
    assert outcome.network.n_weights == outcome.network.n_weights_dense == expected
    assert outcome.health["n_synapses"] == sum(outcome.network.stored) >= expected - 5 * n_inputs


@pytest.mark.parametrize(
    "model",
    [
        Columns(features=4, neighbours=2),
        Columns(features=4, neighbours=2, read_out="shared", arithmetic="float32"),
        Columns(features=4, hidden=(7,), read_out="shared", input_delays=(0, 3), steps_per_sample=2),
        Columns(features=4, neighbours=2, neuron=Resonator(share=0.5)),
    ],
)
def test_copies_are_equal_and_the_network_is_the_one_written_out_by_hand(model):
    of = data()
    outcome = model.fit(of, SHORT, rngs())
    network = outcome.network
    first = network.layers[0]
    n_neighbours = 1 + min(model.neighbours, 5)
    places = [tuple(place) for place in taxels(GRID)]
    # The weights of the first column, of which each other column holds those of the same rank.
    ranks = nearest(taxels(GRID), model.neighbours)
    written = np.zeros_like(first.weight)
    for column in range(6):
        for rank in range(n_neighbours):
            for delay in range(len(model.input_delays)):
                for plane in (0, 1):
                    here, there = (
                        12 * delay + 6 * plane + places.index(places[ranks[c, rank]]) for c in (column, 0)
                    )
                    written[4 * column : 4 * column + 4, here] = first.weight[:4, there]
    np.testing.assert_array_equal(first.weight, written)
    n_different = 8 * n_neighbours * len(model.input_delays)
    assert len(np.unique(first.weight[first.weight != 0])) == n_different
    for value in first.parameters.values():
        if np.ndim(value):
            np.testing.assert_array_equal(value, np.tile(value[:4], 6))
    if model.read_out == "shared":
        second = network.layers[1].weight
        np.testing.assert_array_equal(second, np.tile(second[:, :4], 6))
    by_hand = replace(
        network, layers=(Layer(written, None, first.parameters, first.neuron), *network.layers[1:])
    )
    again = respond(by_hand, of, of.validation)
    np.testing.assert_array_equal(again.output, outcome.validation.output)
    np.testing.assert_array_equal(again.spikes, outcome.validation.spikes)
    assert again.synapses == outcome.validation.synapses
    assert (again.synapses is None) == (model.neighbours >= 5)  # each column then reads all taxels


def test_a_neuron_without_kernel_trains_its_columns_as_well():
    pytest.importorskip("torch")
    from dse.engine.neurons.lif import Lif

    model = Columns(features=3, neighbours=1, neuron=Lif(), arithmetic="float32")
    network = model.fit(data(), replace(SHORT, epochs=1), rngs()).network
    weight, shared = network.layers[0].weight, network.layers[0].shared
    for number in range(12):
        assert len(np.unique(weight[shared == number])) == 1


def test_settings_that_contradict_are_refused():
    with pytest.raises(ValueError, match=r"hidden must have 0 to 2 layers, got 3"):
        Columns(hidden=(1, 2, 3))
