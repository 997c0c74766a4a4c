"""Fewer bits and fewer weights after training: the grid, the exponent, what is stored, what runs."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from dse.base.records import Layer, Network
from dse.engine.neurons.fixed_point import quantise
from dse.measure.objectives.work import memory_bytes
from dse.models.snn.family import SNN
from dse.models.snn.quantise import exponent, rounded
from dse.models.snn.respond import respond
from tests.layers import cuba_parameters
from tests.models.snn.toy import SHORT, fit, rngs, toy

STEP = 1 / 32
BITS = st.integers(2, 8)
SHARES = st.sampled_from([0.0, 0.25, 0.5, 0.9])


def network(*weights, recurrent=None, arithmetic="integer"):
    """Return a network of given matrices, the last layer with given recurrent weights."""
    layers = []
    for number, w in enumerate(weights, 1):
        matrix = np.array(w, np.float32)
        n = matrix.shape[0]
        ring = np.array(recurrent, np.float32) if recurrent is not None and number == len(weights) else None
        layers.append(
            Layer(matrix, ring, cuba_parameters(np.full(n, 1024, np.int32), np.full(n, 128, np.int32), 80))
        )
    return Network(tuple(layers), layers[0].weight.shape[1], (0,), 1, arithmetic)


def matrices(net):
    return [w for x in net.layers for w in (x.weight, x.recurrent) if w is not None]


def deployed(net):
    """Return the 8-bit weights that run, in steps of 1/32."""
    return [quantise(w) / np.float32(STEP) for w in matrices(net)]


WEIGHTS = arrays(
    np.float32,
    st.tuples(st.integers(1, 6), st.integers(1, 6)),
    elements=st.one_of(
        st.floats(-0.5, 0.5, width=32),
        st.floats(-6, 6, width=32),
        st.integers(-140, 140).map(lambda k: k / 32),
    ),
)


@pytest.mark.parametrize(
    ("bits", "expected"),
    [
        (8, [100, -37, 5, 2]),
        (5, [96, -40, 8, 0]),  # e = 3 clips at 120: errors 4, 3, 3, 2
        (3, [96, -32, 0, 0]),  # e = 5: -128 to 96
        (2, [64, -64, 0, 0]),  # e = 6: -128 to 64, two's complement
    ],
)
def test_by_hand(bits, expected):
    net = network([[100 * STEP, -37 * STEP, 5 * STEP, 2 * STEP]])
    [found] = deployed(rounded(net, bits, 0.0))
    assert found.tolist() == [expected]


def test_the_exponent_trades_clipping_against_steps():
    small = [np.full(99, 3 * STEP), np.array([9 * STEP])]
    assert exponent(small, 4) == 0  # 99 weights exact, one clipped from 9 to 7: 4, against 99 + 1 at e = 1
    assert exponent([np.array([3.0, 9.0]) * STEP], 4) == 1  # 1 + 1 against 4
    assert exponent([np.array([0.5, 1.5, 2.5]) * STEP], 8) == 0  # there is no finer step than that of 8 bits
    assert exponent([np.array([8.0, -16.0]) * STEP], 5) == 0  # exact at 0, 1, 2 and 3: the least


def test_ties_go_to_even():
    net = network([[1.5 * STEP, 2.5 * STEP, -0.5 * STEP, -1.5 * STEP, 7 * STEP, -8 * STEP]])
    [found] = deployed(rounded(net, 4, 0.0))
    assert found.tolist() == [[2, 2, 0, -2, 7, -8]]


def test_the_range_is_that_of_twos_complement():
    net = network([[4.0, -4.0, 1e30, -1e30]])
    assert deployed(rounded(net, 8, 0.5))[0].tolist() == [[0, 0, 127, -128]]
    for bits, highest in ((2, 64), (3, 96), (4, 112), (7, 126)):
        assert deployed(rounded(net, bits, 0.0))[0].tolist() == [[highest, -128, highest, -128]], bits


def test_tiny_weights_round_to_0_and_keep_their_place():
    net = network([[1e-30, -1e-6, 0.4 * STEP, -1e-45]])
    found = rounded(net, 4, 0.0)
    assert not deployed(found)[0].any()
    assert found.n_weights == 4
    assert rounded(net, 4, 0.5).n_weights == 0


def test_layers_have_exponents_of_their_own_and_recurrent_weights_that_of_their_layer():
    wide, narrow = [[100 * STEP, -96 * STEP]], [[3 * STEP]]
    apart = rounded(network(wide, narrow), 4, 0.0)
    assert [x.tolist() for x in deployed(apart)] == [[[96, -96]], [[3]]]
    joint = rounded(network(wide, recurrent=narrow), 4, 0.0)
    assert [x.tolist() for x in deployed(joint)] == [[[96, -96]], [[0]]]


def test_pruning_ranks_each_matrix_by_magnitude_and_drops_what_rounds_to_0():
    net = network([[8 * STEP, -4 * STEP, 0.2 * STEP, 6 * STEP]], recurrent=[[0.3 * STEP]])
    found = rounded(net, 8, 0.25)
    assert [x.tolist() for x in deployed(found)] == [[[8, -4, 0, 6]], [[0]]]
    assert found.stored == (4,)  # three, and the recurrent one, of which a quarter is none
    assert rounded(net, 4, 0.5).layers[0].weight.tolist() == [[0.25, 0, 0, 6 * STEP]]
    pruned = network([[8 * STEP, 0.0, 0.2 * STEP, 6 * STEP]])  # in training
    assert rounded(pruned, 4, 0.0).stored == (2,)


@pytest.mark.parametrize("bits", range(2, 9))
def test_nothing_and_next_to_nothing(bits):
    zeros = rounded(network(np.zeros((3, 2)), recurrent=np.zeros((3, 3))), bits, 0.5)
    assert not any(w.any() for w in matrices(zeros)) and zeros.n_weights == 0
    one = rounded(network([[0.25]]), bits, 0.9)  # a share of one weight is none
    assert deployed(one)[0].tolist() == [[8]]


def test_8_bits_and_nothing_pruned_is_the_network_itself():
    net = network([[0.01, 2.0]], [[0.5]])
    assert rounded(net, 8, 0.0) is net


@pytest.mark.parametrize(
    ("changes", "settings", "message"),
    [
        ({"arithmetic": "float32"}, (4, 0.0), "integer arithmetic can be rounded, got float32 arithmetic"),
        ({"arithmetic": "ideal"}, (8, 0.0), "got ideal arithmetic"),
        ({}, (1, 0.0), "weight_bits must be an integer from 2 to 8, got 1"),
        ({}, (9, 0.0), "got 9"),
        ({}, (4.5, 0.0), r"got 4\.5"),
        ({}, (4, 1.0), r"pruned must be in \[0, 1\), got 1\.0"),
        ({}, (4, -0.1), r"got -0\.1"),
        ({}, (4, float("nan")), "got nan"),
    ],
)
def test_what_cannot_be_rounded(changes, settings, message):
    net = network([[1.0, 2.0]])
    with pytest.raises(ValueError, match=message):
        rounded(dataclasses.replace(net, **changes), *settings)


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
def test_weights_that_are_no_numbers(wrong):
    with pytest.raises(ValueError, match=f"weights of layer 2 must be finite numbers, got {wrong}"):
        rounded(network([[1.0]], [[1.0]], recurrent=[[wrong]]), 8, 0.0)


@given(WEIGHTS, BITS)
def test_errors_are_half_a_step_inside_the_range_and_clipped_outside(weights, bits):
    shared = exponent([weights], bits)
    step, limit = 2.0**shared, 2 ** (bits - 1)
    [found] = deployed(rounded(network(weights), bits, 0.0))
    whole = found / step
    assert 0 <= shared <= 8 - bits
    assert (whole == np.rint(whole)).all() and (whole >= -limit).all() and (whole < limit).all()
    exact = weights.astype(np.float64) / STEP
    inside = (exact >= -limit * step) & (exact <= (limit - 1) * step)
    assert (np.abs(found - exact)[inside] <= step / 2).all()
    assert (whole[exact > (limit - 1) * step] == limit - 1).all()
    assert (whole[exact < -limit * step] == -limit).all()


@given(WEIGHTS, WEIGHTS, BITS, SHARES)
def test_rounding_again_changes_nothing_and_the_original_stays(first, second, bits, pruned):
    net = network(first, second)
    copies = [w.copy() for w in matrices(net)]
    once = rounded(net, bits, pruned)
    for one, two in zip(matrices(once), matrices(rounded(once, bits, pruned)), strict=True):
        np.testing.assert_array_equal(one, two)
    for before, after in zip(copies, matrices(net), strict=True):
        np.testing.assert_array_equal(before, after)


@given(WEIGHTS)
def test_the_squared_error_never_falls_with_fewer_bits(weights):
    clipped = np.clip(weights / np.float64(STEP), -128, 127)
    errors = [
        ((deployed(rounded(network(weights), b, 0.0))[0] - clipped) ** 2).sum() for b in range(8, 1, -1)
    ]
    assert (np.diff(errors) >= -1e-9).all()


@given(WEIGHTS, BITS)
def test_memory_falls_with_bits_and_with_what_is_pruned(weights, bits):
    net = network(weights)
    found = [memory_bytes(rounded(net, bits, p).n_weights, bits) for p in (0.0, 0.2, 0.4, 0.6, 0.8)]
    assert (np.diff(found) <= 0).all()
    if (weights != 0).all():
        assert found[0] == weights.size * bits / 8


@pytest.mark.parametrize("recurrent", [False, True])
def test_a_trained_network_answers_as_deployed_and_with_fewer_bits_like_its_own_8_bit_weights(recurrent):
    data = toy()
    trained = fit(data, SNN(hidden=(10,), recurrent=recurrent), SHORT, rngs())
    same = respond(rounded(trained.network, 8, 0.0), data, data.validation)
    for name in ("output", "spikes", "updates"):
        np.testing.assert_array_equal(getattr(same, name), getattr(trained.validation, name))
    assert dataclasses.replace(same, output=None, spikes=None, updates=None) == dataclasses.replace(
        trained.validation, output=None, spikes=None, updates=None
    )
    fewer = rounded(trained.network, 3, 0.5)
    whole = dataclasses.replace(
        fewer,
        layers=tuple(
            dataclasses.replace(
                x, weight=quantise(x.weight), recurrent=None if x.recurrent is None else quantise(x.recurrent)
            )
            for x in fewer.layers
        ),
    )
    assert all((a == b).all() for a, b in zip(matrices(fewer), matrices(whole), strict=True))
    said = respond(fewer, data, data.validation)
    assert said.synapses is not None and fewer.n_weights < 0.6 * trained.network.n_weights
    assert not np.array_equal(said.spikes, trained.validation.spikes)
