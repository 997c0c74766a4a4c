"""Layers with resonators: the kernels against the definition, and CUBA-LIF beside them as alone."""

import numpy as np
import pytest

from benchmarks.ours import rows_of
from dse.engine import cpu
from dse.engine.definition import DefinedLayer
from dse.engine.events import dense
from dse.engine.layers import prepare, weights
from dse.engine.member import Member, TrainedLayer, Turn
from dse.engine.network import gradients
from dse.engine.neurons import LayerSpec, cuba_lif
from dse.engine.neurons.fixed_point import quantise
from dse.engine.neurons.resonator import Population, Resonator
from dse.engine.neurons.surrogate import exponential

N_IN, N_HIDDEN, N_OUT = 12, 20, 4


def population(share=0.5, *, reset=False, n=N_HIDDEN):
    neuron = Resonator(share=share, reset=reset, current_decay=(0.1, 0.9), voltage_decay=(0.05, 0.5))
    drawn = neuron.population(LayerSpec(n, False, 1, 1.0), np.random.default_rng(2))
    assert isinstance(drawn, Population)
    return drawn


def layer(rng, of, *, recurrent=False):
    n = len(of.resonates)
    ring = quantise(rng.normal(0, 0.3, (n, n))) if recurrent else None
    return weights(quantise(rng.normal(0.1, 0.6, (N_IN, n))), ring, of)


@pytest.mark.parametrize("arithmetic", ["integer", "ideal"])
@pytest.mark.parametrize("recurrent", [False, True])
@pytest.mark.parametrize(("share", "reset"), [(1.0, False), (0.4, True)])
def test_the_kernel_answers_bit_for_bit_as_the_definition(arithmetic, recurrent, share, reset):
    rng = np.random.default_rng(5)
    x = (rng.random((3, 300, N_IN)) < 0.1).astype(np.uint8)
    x[:, 200:] = 0  # resonators ring on, and end
    of = layer(rng, population(share, reset=reset), recurrent=recurrent)
    by_kernel = prepare(of, arithmetic).forward(rows_of(x), keep_voltage=True, count=True)
    by_definition = DefinedLayer(of, arithmetic).forward(rows_of(x), keep_voltage=True, count=True)
    assert 0.02 < by_kernel.fired.index.size / x.shape[0] / x.shape[1] / N_HIDDEN < 0.5
    np.testing.assert_array_equal(dense(by_definition.fired), dense(by_kernel.fired))
    kind = by_kernel.voltage.dtype
    np.testing.assert_array_equal(by_definition.voltage.astype(kind), by_kernel.voltage)
    np.testing.assert_array_equal(by_definition.updates, by_kernel.updates)
    assert by_definition.peak == by_kernel.peak
    if arithmetic == "integer" and not recurrent:
        assert by_kernel.updates[:, 299].max() < N_HIDDEN < 2 * by_kernel.updates[:, 100].min()


@pytest.mark.parametrize("arithmetic", ["integer", "float32", "ideal"])
@pytest.mark.parametrize("recurrent", [False, True])
def test_gradients_agree_with_automatic_differentiation(arithmetic, recurrent):
    from dse.engine.autograd import gradients as by_autograd

    rng = np.random.default_rng(7)
    x = (rng.random((4, 25, N_IN)) < 0.25).astype(np.uint8)
    outputs = cuba_lif.Population(rng.integers(0, 4097, N_OUT), rng.integers(0, 4097, N_OUT), 80)
    layers = [
        layer(rng, population(reset=True), recurrent=recurrent),
        weights(quantise(rng.normal(0.1, 0.5, (N_HIDDEN, N_OUT))), None, outputs),
    ]
    gains = [np.full((4, 1), 1.25, np.float32), 2 * (rng.random((4, N_HIDDEN)) < 0.5).astype(np.float32)]
    arguments = (rows_of(x), layers, [exponential(80 / 64, 0.03, 3.0)] * 2, np.array([0, 3, 1, 1]))
    settings = {"true_rate": 0.6, "false_rate": 0.05, "gains": gains}
    of_kernels = gradients(*arguments, arithmetic=arithmetic, **settings)
    exact = "integer" if arithmetic == "integer" else "ideal"
    loss, feed_forward, rings = by_autograd(*arguments, arithmetic=exact, **settings)
    assert of_kernels.loss == pytest.approx(loss, rel=1e-6)
    for ours, theirs in zip(of_kernels.feed_forward, feed_forward, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-5 * np.abs(theirs).max())
    for ours, theirs in zip(of_kernels.recurrent, rings, strict=False):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-5 * np.abs(theirs).max())


@pytest.mark.parametrize("arithmetic", ["integer", "float32", "ideal"])
def test_cuba_lif_neurons_beside_resonators_are_those_of_a_layer_of_their_own(arithmetic):
    """All columns, silent ones included, and every bit of the gradient."""
    rng = np.random.default_rng(8)
    mixed = population(0.5)
    of, lif = layer(rng, mixed), ~mixed.resonates
    alone = weights(
        of.feed_forward[:, lif], None,
        cuba_lif.Population(mixed.decay_current[lif], mixed.decay_voltage[lif], mixed.threshold),
    )  # fmt: skip
    x = (rng.random((3, 60, N_IN)) < 0.2).astype(np.uint8)
    surrogate = exponential(80 / 64, 0.03, 3.0)
    arguments = {"true_rate": 0.6, "false_rate": 0.05, "gains": [None]}
    results = [prepare(w, arithmetic).forward(rows_of(x), keep_voltage=True) for w in (of, alone)]
    np.testing.assert_array_equal(results[0].voltage[..., lif], results[1].voltage)
    grads = [
        gradients(rows_of(x), [w], [surrogate], labels, arithmetic=arithmetic, **arguments).feed_forward[0]
        for w, labels in ((of, np.array([10, 15, 12])), (alone, np.array([0, 5, 2])))
    ]
    np.testing.assert_array_equal(grads[0][:, lif], grads[1])


def member(of, arithmetic):
    rng = np.random.default_rng(3)
    output = cuba_lif.Population(np.int32(1000), np.int32(300), 80)
    layers = tuple(
        TrainedLayer(
            rng.normal(0.15, 0.5, shape).astype(np.float32), None, neurons, exponential(80 / 64, 0.03, 3.0),
            np.ones(shape[1], np.float32),
        )
        for shape, neurons in (((N_IN, N_HIDDEN), of), ((N_HIDDEN, N_OUT), output))
    )  # fmt: skip
    return Member(layers, 0.6, 0.05, arithmetic)


def test_a_member_trains_the_same_alone_and_beside_other_neurons():
    rng = np.random.default_rng(9)
    x, labels = (rng.random((6, 30, N_IN)) < 0.2).astype(np.uint8), rng.integers(0, N_OUT, 6)
    lif = cuba_lif.Population(np.int32(900), np.int32(200), 80)
    members = [member(population(), "integer"), member(lif, "integer"), member(population(1.0), "float32")]
    together = cpu.start(members, 6, 30)
    turn = Turn(0.02, (None, None))
    for _ in range(3):
        together.step(rows_of(x), labels, dict.fromkeys(range(3), turn))
    for number, of in enumerate(members):
        alone = cpu.start([of], 6, 30)
        for _ in range(3):
            alone.step(rows_of(x), labels, {0: turn})
        for a, b in zip(alone.masters(0).feed_forward, together.masters(number).feed_forward, strict=True):
            np.testing.assert_array_equal(a, b)
        assert (alone.masters(0).feed_forward[0] != of.layers[0].feed_forward).any()
