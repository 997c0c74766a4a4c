"""Thresholds on finer grids, and weights of regions dithered to 8 bits: what runs is what was trained."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.ours import rows_of
from dse.base.records import Dataset
from dse.engine.forward import prepare
from dse.engine.layers import weights
from dse.engine.neurons import cuba_lif
from dse.engine.neurons.fixed_point import STATE_LIMIT, quantise
from dse.engine.neurons.lif import Lif
from dse.engine.neurons.resonator import Resonator
from dse.models.snn import contrasts
from dse.models.snn.family import SNN
from dse.models.snn.quantise import dithered, finer, finest
from dse.models.snn.respond import respond
from dse.models.training import Training
from dse.testing.small import spikes_of
from tests.models.snn.test_regions import array
from tests.models.snn.toy import accuracy, rngs, toy


@given(
    sizes=st.tuples(st.integers(1, 200), st.integers(1, 5), st.integers(1, 20)), seed=st.integers(0, 2**30)
)
def test_the_sum_over_a_pool_is_that_of_the_weight_rounded_once(sizes, seed):
    n_inputs, n_pools, n_neurons = sizes
    rng = np.random.default_rng(seed)
    pool = rng.integers(0, n_pools, n_inputs)
    of_pools = rng.normal(0, 0.3, (n_pools, n_neurons)).astype(np.float32)
    deployed = 32 * quantise(dithered(of_pools, pool)).astype(np.float64)
    assert (np.abs(deployed - 32 * of_pools[pool].astype(np.float64)) < 1).all()
    totals, expected = (
        np.zeros((n_pools, n_neurons)),
        np.bincount(pool, minlength=n_pools)[:, None] * of_pools * 32,
    )
    np.add.at(totals, pool, deployed)
    assert (np.abs(totals - expected) <= 0.5 + 1e-3).all()


def test_of_any_run_of_channels_the_right_share_is_rounded_up():
    of_pool = np.full((1, 50), 0.3 / 32, np.float32)
    up = quantise(dithered(of_pool, np.zeros(400, int))) > 0
    for first in range(0, 380, 7):
        for n in (5, 20):
            assert (np.abs(up[first : first + n].sum(axis=0) - 0.3 * n) < 2).all()
    assert len(np.unique(up, axis=1).T) > 40  # neurons round different channels up


def test_a_weight_that_rounds_to_0_everywhere_stays_a_weight():
    few = dithered(np.array([[1e-4, -1e-4]], np.float32), np.zeros(9, int))
    assert (few > 0).all(axis=0).tolist() == [True, False] and (few < 0).all(axis=0).tolist() == [False, True]
    assert not quantise(few).any()


def test_the_finest_exponent_holds_the_largest_weight():
    assert finest(np.array([0.2, -0.24]), 8) == 4
    assert finest(np.array([127 / 32]), 8) == 0
    assert finest(np.array([100.0]), 8) == finest(np.array([-4.0]), 8) == 0
    assert finest(np.zeros(3), 8) == 8


@given(
    exponent=st.integers(0, 8), arithmetic=st.sampled_from(["float32", "ideal"]), seed=st.integers(0, 2**30)
)
@pytest.mark.parametrize("kind", ["cuba_lif", "resonator"])
def test_thresholds_and_weights_of_a_finer_grid_are_the_same_network(kind, exponent, arithmetic, seed):
    rng = np.random.default_rng(seed)
    rows = rows_of((rng.random((3, 60, 20)) < 0.2).astype(np.uint8))
    matrix = rng.normal(0, 0.3, (20, 9)).astype(np.float32)
    neurons = cuba_lif.rounded(0.25, 0.03, 1.25)
    if kind == "resonator":
        from dse.engine.neurons import LayerSpec

        neurons = Resonator().population(LayerSpec(9, False, 1, 1.0), rng)
    plain = prepare(weights(matrix, None, neurons), arithmetic).forward(rows)
    scaled = matrix * np.float32(2.0**exponent)
    fine = prepare(weights(scaled, None, finer(neurons, exponent)), arithmetic).forward(rows)
    np.testing.assert_array_equal(plain.fired.offsets, fine.fired.offsets)
    np.testing.assert_array_equal(plain.fired.index, fine.fired.index)


def touched(n=90, side=12, n_steps=60):
    """Return a small scene: many pools swing together, and classes differ in how strongly, by ring."""
    rng = np.random.default_rng(5)
    positions = array(side, side)
    radius = np.hypot(*(positions[:, :2] - (side - 1) / 2).T) / (side / 2)
    target = np.arange(n) % 3
    swing = 0.5 + 0.5 * np.sin(np.arange(n_steps) / 4 + rng.uniform(0, 6, n)[:, None])
    strength = np.array([[0.10, 0.22], [0.16, 0.16], [0.22, 0.10]])[target]
    by_place = np.where(radius < 0.55, strength[:, :1], strength[:, 1:])
    x = rng.random((n, n_steps, side * side)) < swing[..., None] * by_place[:, None]
    order = rng.permutation(n)
    start = np.zeros(n, np.int32)
    parts = (np.sort(order[: 2 * n // 3]), np.sort(order[2 * n // 3 :]), np.zeros(0, np.int64))
    return Dataset(
        spikes_of(x, 1.0),
        target.astype(np.int64),
        ("a", "b", "c"),
        start,
        start,
        start,
        n_steps,
        *parts,
        positions,
    )


TRAINING = Training(
    epochs=12, batch_size=10, learning_rate=0.05, dropout=0.0, average_epochs=1, step_unit="initial"
)
LEVELS = {"hidden": (48,), "regions": 12, "start": "contrasts", "true_rate": 0.5}


def test_a_dithered_network_answers_nearly_as_the_real_one_and_holds_8_and_24_bits(monkeypatch):
    monkeypatch.setattr(contrasts, "_CANDIDATES", 1024)  # weights that need 8 bits are among so many
    data = touched()
    real = SNN(**LEVELS, arithmetic="float32").fit(data, TRAINING, rngs())
    eight = SNN(**LEVELS, rounding="dithered").fit(data, TRAINING, rngs())
    network = eight.network
    assert accuracy(real, data) >= 0.9
    assert accuracy(eight, data) >= accuracy(real, data) - 0.1
    first = network.layers[0]
    mantissa = first.weight * 32
    small = np.abs(first.weight) <= 1 / 64
    np.testing.assert_array_equal(mantissa[~small], np.rint(mantissa[~small]))
    exponent = np.log2(first.parameters["threshold"] / 80)
    assert exponent >= 0 and exponent == int(exponent)
    assert np.abs(first.weight).max() > 127 / 32 / 2 or 2 * eight.health["peak_state"] > STATE_LIMIT * 15 / 16
    assert eight.health["peak_state"] <= STATE_LIMIT and not eight.health["overflows_24_bit"]
    assert network.n_weights == network.n_weights_dense == 144 * 48 + 48 * 3
    again = respond(network, data, data.validation)
    np.testing.assert_array_equal(again.output, eight.validation.output)


def test_on_the_grid_of_the_threshold_itself_such_weights_are_lost():
    """Why exponents are needed: 1/32 is more than all weights of a start by contrasts."""
    data = touched()
    coarse = SNN(**LEVELS).fit(data, TRAINING, rngs())
    assert coarse.health["dead_neurons"] > 12
    fine = SNN(**LEVELS, threshold_exponents=(8, 2)).fit(data, TRAINING, rngs())
    assert fine.health["dead_neurons"] < coarse.health["dead_neurons"] - 3
    layers = fine.network.layers
    assert [int(x.parameters["threshold"]) for x in layers] == [80 * 256, 80 * 4]


@pytest.mark.parametrize("given", [3, -1])
def test_given_exponents_are_those_of_the_network(given):
    data = touched(n=30)
    training = replace(TRAINING, epochs=2)
    model = SNN(**LEVELS, rounding="dithered", threshold_exponents=(given, 2))
    layers = model.fit(data, training, rngs()).network.layers
    thresholds = [int(x.parameters["threshold"]) for x in layers]
    assert thresholds[1] == 80 * 4 and (thresholds[0] == 80 * 8) == (given == 3)


def test_a_start_moves_by_the_same_share_on_every_grid():
    """Real states: weights, thresholds and steps are scaled alike."""
    data = toy(n=20)
    training = Training(
        epochs=1, batch_size=20, learning_rate=0.002, step_unit="weight", average_epochs=1, dropout=0
    )
    plain, fine = (
        SNN(hidden=(9,), arithmetic="float32", threshold_exponents=k).fit(data, training, rngs()).network
        for k in ((), (4, 3))
    )
    for a, b, k in zip(plain.layers, fine.layers, (4, 3), strict=True):
        np.testing.assert_allclose(a.weight, b.weight / 2.0**k, rtol=1e-3, atol=1e-5)


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({"rounding": "dithered"}, "rounding must be nearest without regions"),
        ({"rounding": "dithered", "regions": 3, "arithmetic": "float32"}, "rounding must be nearest without"),
        ({"rounding": "dithered", "regions": 3, "recurrent": True}, "must be 0 or more where a recurrent"),
        ({"threshold_exponents": (-1, 1)}, "0 or more for layers that are neither dithered"),
        ({"hidden": (4, 4), "threshold_exponents": (0, -1, 1)}, "0 or more for layers that are neither"),
        ({"threshold_exponents": (1,)}, "one exponent for each of the 2 layers"),
        ({"threshold_exponents": (1, 8), "neuron": cuba_lif.CubaLif(threshold=20.0)}, "must be at most 6"),
        (
            {"threshold_exponents": (1, 1), "neuron": Lif(), "arithmetic": "float32"},
            "need neurons with a kernel",
        ),
    ],
)
def test_settings_that_do_not_fit_are_refused(keys, sentence):
    with pytest.raises(ValueError, match=sentence):
        SNN(**keys)
