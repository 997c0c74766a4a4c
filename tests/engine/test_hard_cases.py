"""States and spikes at the limits, bit for bit against the equations of dse.engine.neurons."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.ours import rows_of
from dse.engine.events import dense
from dse.engine.layers import prepare, weights
from dse.engine.network import answer, gradients
from dse.engine.neurons import cuba_lif, fixed_point
from dse.engine.neurons.surrogate import exponential

LOWEST, HIGHEST = np.float32(-4), np.float32(254 / 64)


def assert_defined(x, layer, arithmetic):
    """Check potentials and spikes against dse.engine.neurons; return the potentials in weight units."""
    z = x.astype(np.float64) @ layer.feed_forward.astype(np.float64)
    _, voltage, spikes = cuba_lif.run(z, layer.population, arithmetic)
    found = prepare(layer, arithmetic).forward(rows_of(x), keep_voltage=True)
    np.testing.assert_array_equal(dense(found.fired), spikes)
    np.testing.assert_array_equal(found.voltage, voltage.astype(found.voltage.dtype))
    return voltage


@given(
    seed=st.integers(0, 2**32 - 1),
    n_steps=st.integers(1, 60),
    n_inputs=st.integers(1, 40),
    n_neurons=st.integers(1, 90),
    density=st.sampled_from([0.0, 0.02, 0.5, 1.0]),
    scale=st.sampled_from([0.02, 0.5, 10.0]),
    threshold=st.integers(1, 2000),
)
def test_any_layer_equals_its_definition(seed, n_steps, n_inputs, n_neurons, density, scale, threshold):
    rng = np.random.default_rng(seed)
    x = (rng.random((2, n_steps, n_inputs)) < density).astype(np.uint8)
    w = fixed_point.quantise(rng.normal(0, scale, (n_inputs, n_neurons)))
    decays = (rng.integers(0, 4097, n_neurons) for _ in range(2))
    assert_defined(x, weights(w, None, cuba_lif.Population(*decays, threshold)), "integer")


@pytest.mark.parametrize("weight", [LOWEST, HIGHEST])
@pytest.mark.parametrize("decay", [0, 1, 4095, 4096])
def test_every_input_fires_every_step_into_clipped_weights(weight, decay):
    layer = weights(
        np.full((300, 3), weight), None, cuba_lif.Population(np.int32(decay), np.int32(decay), 80)
    )
    assert_defined(np.ones((1, 50, 300), np.uint8), layer, "integer")


def test_states_beyond_24_bits_stay_exact_and_are_reported():
    layer = weights(
        np.full((300, 2), HIGHEST), None, cuba_lif.Population(np.int32(0), np.int32(0), 2**17 - 1)
    )
    x = np.ones((1, 200, 300), np.uint8)
    voltage = assert_defined(x, layer, "integer")
    assert np.abs(voltage).max() * 4096 > fixed_point.STATE_LIMIT
    assert answer(rows_of(x), [prepare(layer, "integer")]).peak * 4096 > fixed_point.STATE_LIMIT


@pytest.mark.parametrize("arithmetic", ["integer", "ideal"])
def test_twenty_thousand_steps_equal_the_definition(arithmetic):
    rng = np.random.default_rng(3)
    x = (rng.random((2, 20_000, 5)) < 0.01).astype(np.uint8)
    w = fixed_point.quantise(rng.normal(0, 1, (5, 3)))
    assert_defined(x, weights(w, None, cuba_lif.Population(np.int32(3), np.int32(1), 500)), arithmetic)


def test_a_trace_ends_at_zero_before_it_becomes_denormal():
    x = np.zeros((1, 3000, 1), np.uint8)
    x[0, 0] = 1
    layer = weights(
        np.full((1, 2), 1.0, np.float32), None, cuba_lif.Population(np.int32(400), np.int32(400), 1000)
    )
    single, double = (
        prepare(layer, arithmetic).forward(rows_of(x), keep_voltage=True).voltage[0, :, 0]
        for arithmetic in ("float32", "ideal")
    )
    assert single[-1] == 0 and (single[single != 0] > np.finfo(np.float32).tiny).all()
    np.testing.assert_allclose(single, double, rtol=1e-3, atol=1e-28)


@pytest.mark.parametrize("arithmetic", ["integer", "float32", "ideal"])
@pytest.mark.parametrize(
    "x",
    [
        np.zeros((2, 7, 12), np.uint8),
        np.ones((2, 7, 12), np.uint8),
        np.ones((1, 1, 12), np.uint8),
        np.zeros((0, 5, 12), np.uint8),
    ],
    ids=["silence", "every input fires", "one step", "no samples"],
)
def test_gradients_of_extreme_inputs_are_finite(x, arithmetic):
    rng = np.random.default_rng(8)
    layers = [
        weights(
            fixed_point.quantise(rng.normal(0, 0.5, shape)),
            None,
            cuba_lif.Population(np.int32(1000), np.int32(100), 80),
        )
        for shape in ((12, 70), (70, 4))
    ]
    labels = np.zeros(len(x), np.int64)
    found = gradients(
        rows_of(x),
        layers,
        [exponential(80 / 64, 0.03, 3.0)] * 2,
        labels,
        true_rate=0.8,
        false_rate=0.0,
        arithmetic=arithmetic,
        gains=[None, None],
    )
    assert np.isfinite(found.loss) and all(np.isfinite(g).all() for g in found.feed_forward)
    if not x.any():
        assert all((g == 0).all() for g in found.feed_forward)


@pytest.mark.parametrize("scale", [1e-30, 1e30])
def test_gradients_of_tiny_and_huge_real_weights_are_finite(scale):
    rng = np.random.default_rng(9)
    layers = [
        weights(
            (scale * rng.normal(0, 0.5, shape)).astype(np.float32),
            None,
            cuba_lif.Population(np.int32(1000), np.int32(100), 80),
        )
        for shape in ((12, 20), (20, 4))
    ]
    x = (rng.random((3, 30, 12)) < 0.4).astype(np.uint8)
    labels = np.array([0, 1, 3])
    found = gradients(
        rows_of(x),
        layers,
        [exponential(80 / 64, 0.03, 3.0)] * 2,
        labels,
        true_rate=0.8,
        false_rate=0.0,
        arithmetic="ideal",
        gains=[None, None],
    )
    assert all(np.isfinite(g).all() for g in found.feed_forward)
