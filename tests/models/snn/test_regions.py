"""Regions: which channels share weights, and networks that train on counts per region."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.ours import rows_of
from dse.engine.events import pooled
from dse.engine.forward import prepare
from dse.engine.layers import CompiledLayer, has_kernel, laid_out, weights
from dse.engine.network import gradients
from dse.engine.neurons import cuba_lif
from dse.engine.neurons.lif import Lif
from dse.engine.neurons.resonator import Resonator
from dse.engine.neurons.surrogate import exponential
from dse.engine.neurons.xylo_lif import XyloLif
from dse.engine.stepping import RunningStack
from dse.models.snn.family import SNN
from dse.models.snn.regions import regions_of
from tests.models.snn.toy import SHORT, rngs, toy


def array(width, height, planes=1):
    """Return the positions of a full array of taxels."""
    return np.array([(x, y, p) for p in range(planes) for y in range(height) for x in range(width)], np.int32)


def test_regions_of_a_camera_are_rings_of_quarters():
    positions = array(78, 78)
    region = regions_of(positions, 12)
    x, y = (positions[:, :2] - 38.5).T
    for k in range(12):
        sector = (np.sign(x), np.sign(y))
        assert all(len(np.unique(side[region == k])) == 1 for side in sector)
    radius = np.hypot(x, y) / 39
    inner, middle, outer = (radius[region % 3 == ring] for ring in range(3))
    assert inner.max() == pytest.approx(0.28, abs=0.01) == middle.min()
    assert middle.max() == pytest.approx(0.56, abs=0.01) == outer.min()


@given(
    places=st.sets(st.tuples(st.integers(0, 30), st.integers(0, 30)), min_size=3, max_size=120),
    thirds=st.integers(1, 12),
    planes=st.integers(1, 3),
)
def test_every_place_has_a_region_and_every_region_a_place(places, thirds, planes):
    positions = np.array([(x, y, 4 * p) for x, y in places for p in range(planes)], np.int32)
    n = 3 * thirds
    if len(places) < n:
        with pytest.raises(ValueError, match=f"at most the {len(places)} places"):
            regions_of(positions, n)
        return
    region = regions_of(positions, n)
    np.testing.assert_array_equal(np.unique(region), np.arange(n * planes))
    np.testing.assert_array_equal(
        region.reshape(-1, planes) // n, np.arange(planes) + 0 * region[::planes, None]
    )
    shuffled = np.random.default_rng(0).permutation(len(positions))
    np.testing.assert_array_equal(regions_of(positions[shuffled], n), region[shuffled])


def batch(n, n_steps, n_inputs, n_pools, seed):
    """Return random rows, and the pool of each input; the first inputs see to it that none is empty."""
    rng = np.random.default_rng(seed)
    pool = np.concatenate([np.arange(n_pools), rng.integers(0, n_pools, n_inputs - n_pools)])
    return rows_of((rng.random((n, n_steps, n_inputs)) < rng.random()).astype(np.uint8)), pool


@given(
    sizes=st.tuples(st.integers(1, 5), st.integers(1, 40), st.integers(6, 300), st.integers(1, 6)),
    hidden=st.integers(1, 70),
    seed=st.integers(0, 2**30),
)
def test_counts_give_the_bits_of_the_full_matrix_in_integers(sizes, hidden, seed):
    """Forward: every spike and the loss. Backward: the gradient of a region is the sum over its channels."""
    n, n_steps, n_inputs, n_pools = sizes
    rows, pool = batch(n, n_steps, n_inputs, n_pools, seed)
    rng = np.random.default_rng(seed)
    of_regions = rng.integers(-40, 41, (n_pools, hidden)) / 32
    output = rng.integers(-128, 128, (hidden, 3)) / 32
    neurons = cuba_lif.rounded(0.25, 0.03, 1.25)
    labels, surrogate = rng.integers(0, 3, n), exponential(1.25, 0.03, 3.0)
    found, expected = (
        gradients(
            x,
            [weights(w, None, neurons), weights(output, None, neurons)],
            [surrogate] * 2,
            labels,
            true_rate=0.5,
            false_rate=0.1,
            gains=[np.full((n, 1), 1.25, np.float32), None],
        )
        for x, w in ((pooled(rows, pool), of_regions), (rows, of_regions[pool]))
    )
    assert found.loss == expected.loss and found.fired == expected.fired
    np.testing.assert_array_equal(found.feed_forward[1], expected.feed_forward[1])
    summed = np.zeros((n_pools, hidden))
    np.add.at(summed, pool, expected.feed_forward[0].astype(np.float64))
    np.testing.assert_allclose(found.feed_forward[0], summed, rtol=1e-4, atol=1e-5 * np.abs(summed).max())


@pytest.mark.parametrize("arithmetic", ["integer", "float32", "ideal"])
def test_inputs_of_equal_weights_are_counted_when_a_network_answers(arithmetic):
    """As rows of samples and step by step, bit for bit; in integers with the bits of every input alone."""
    rows, pool = batch(3, 50, 60, 5, 7)
    rng = np.random.default_rng(1)
    of_pools = (rng.integers(-20, 40, (5, 20)) / 32).astype(np.float32)
    neurons = cuba_lif.rounded(0.25, 0.03, 1.25)
    layer = prepare(weights(of_pools[pool], None, neurons), arithmetic)
    assert isinstance(layer, CompiledLayer) and layer.pool is not None
    fired = layer.forward(rows).fired
    assert fired.index.size > 100
    alone = CompiledLayer(laid_out(weights(of_pools[pool], None, neurons), arithmetic), 20)
    np.testing.assert_array_equal(alone.forward(rows).fired.index, fired.index)
    sample = slice(rows.offsets[0], rows.offsets[50])
    stack, sent = RunningStack([layer], 60, (0,), 1), []
    for t in range(50):
        stack.step(rows.index[sample][rows.offsets[t] : rows.offsets[t + 1]])
        sent.append(stack.fired[0].copy())
    np.testing.assert_array_equal(np.concatenate(sent), fired.index[: fired.offsets[50]])


def placed(width=4, height=3, **keys):
    return replace(toy(n_channels=width * height, **keys), positions=array(width, height))


def test_a_network_of_regions_is_stored_as_a_full_matrix_with_equal_weights():
    data = placed()
    model = SNN(hidden=(20,), regions=6, input_delays=(0, 3), recurrent=True)
    network = model.fit(data, SHORT, rngs()).network
    first, pool = network.layers[0], model.pool(data.positions)
    assert first.weight.shape == (20, 24) and first.shared is None and pool is not None
    np.testing.assert_array_equal(
        first.weight, first.weight[:, np.unique(pool, return_index=True)[1]][:, pool]
    )
    assert len(np.unique(first.weight, axis=1).T) == 12
    assert network.n_weights == network.n_weights_dense == model.n_weights(12, 3) == 24 * 20 + 400 + 60


@pytest.mark.parametrize("arithmetic", ["integer", "float32"])
def test_regions_of_one_channel_each_are_free_weights(arithmetic):
    data = placed(12, 1)
    tied, free = (
        SNN(hidden=(20,), regions=n, arithmetic=arithmetic).fit(data, SHORT, rngs()).network for n in (12, 0)
    )
    for a, b in zip(tied.layers, free.layers, strict=True):  # gradients sum the same numbers in another order
        np.testing.assert_allclose(a.weight, b.weight, atol=1e-4)


def test_neurons_without_a_kernel_train_on_regions_too():
    pytest.importorskip("torch")
    data = placed(n=20)
    outcome = SNN(hidden=(8,), neuron=Lif(), arithmetic="float32", regions=3).fit(data, SHORT, rngs())
    assert len(np.unique(outcome.network.layers[0].weight, axis=1).T) == 3


@pytest.mark.parametrize("neuron", [Lif(), Resonator(), XyloLif()], ids=["lif", "resonator", "xylo_lif"])
def test_any_neuron_whose_potential_has_a_limit_starts_by_contrasts(neuron):
    if not has_kernel(neuron.Populations):
        pytest.importorskip("torch")
    model = SNN(hidden=(12,), neuron=neuron, arithmetic="float32", regions=3, start="contrasts")
    outcome = model.fit(placed(n=24), replace(SHORT, epochs=1, average_epochs=1), rngs())
    assert 0.01 < outcome.health["initial_rates"][0] < 1.0
    assert outcome.health["dead_neurons"] < 6


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({"regions": 4}, "regions must be a multiple of 3"),
        ({"regions": 3, "max_delay": 5}, "max_delay must be 0"),
    ],
)
def test_settings_that_do_not_fit_are_refused(keys, sentence):
    with pytest.raises(ValueError, match=sentence):
        SNN(**keys)
