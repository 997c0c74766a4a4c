"""The engine against golden vectors and against the equations of dse.engine.neurons."""

from itertools import pairwise

import numpy as np
import pytest

from benchmarks.ours import rows_of
from dse.engine.events import delayed, dense
from dse.engine.layers import prepare, weights
from dse.engine.losses.count_cross_entropy import CountCrossEntropy
from dse.engine.losses.spike_rate import SpikeRate
from dse.engine.network import answer, gradients
from dse.engine.neurons import cuba_lif, fixed_point
from dse.engine.neurons.calculus import NumpyCalculus
from dse.engine.neurons.surrogate import exponential
from tests.golden import cases


@pytest.mark.parametrize("case", cases())
def test_the_engine_is_golden(case):
    given = case.settings["params"]
    population = cuba_lif.rounded(given["current_decay"], given["voltage_decay"], given["threshold"])
    raw = [case.given(f"w{k}") for k in range(1, case.n_layers + 1)]
    used = [fixed_point.quantise(w) if case.mode == "quant" else w for w in raw]
    layers = [weights(w.T, None, population) for w in used]
    rows, shifts = rows_of(case.given("x")), case.settings["delay_shift"]
    inputs = rows
    for depth, layer in enumerate(layers, 1):
        done = prepare(layer, "integer" if case.integer else "ideal").forward(inputs, keep_voltage=True)
        np.testing.assert_array_equal(dense(done.fired), case.expected(f"spk{depth}"))
        golden = case.state("vol", depth)
        np.testing.assert_array_equal(done.voltage, golden.astype(done.voltage.dtype))
        inputs = delayed(done.fired) if shifts else done.fired
    np.testing.assert_array_equal(dense(inputs), case.expected("out"))

    surrogate = exponential(population.to_threshold, given["tau_grad"], given["scale_grad"])
    found = gradients(
        rows,
        layers,
        [surrogate] * len(layers),
        case.given("labels"),
        true_rate=case.settings["true_rate"],
        false_rate=case.settings["false_rate"],
        arithmetic="integer" if case.integer else "ideal",
        gains=[None] * len(layers),
        shift=shifts,
    )
    assert found.loss == pytest.approx(float(case.expected("loss")), rel=1e-6, abs=1e-12)
    for depth, by_weight in enumerate(found.feed_forward, 1):
        passes = fixed_point.quantise_passes(raw[depth - 1]) if case.mode == "quant" else 1
        golden = case.expected(f"grad_w{depth}")
        bound = 1e-5 * max(np.abs(golden).max(), 1e-30)
        np.testing.assert_allclose(by_weight.T * passes, golden, rtol=0, atol=bound)


def small_layers(rng, recurrent=False):
    """Return a 12-9-4 stack on the 8-bit grid with a decay of its own per neuron."""
    layers = []
    for n_in, n_out in ((12, 9), (9, 4)):
        ring = fixed_point.quantise(rng.normal(0, 0.4, (n_out, n_out))) if recurrent and n_out == 9 else None
        layers.append(
            weights(
                fixed_point.quantise(rng.normal(0.1, 0.5, (n_in, n_out))),
                ring,
                cuba_lif.Population(rng.integers(0, 4097, n_out), rng.integers(0, 4097, n_out), 80),
            )
        )
    return layers


@pytest.mark.parametrize("integer", [True, False])
@pytest.mark.parametrize("recurrent", [True, False])
def test_states_equal_the_definition_stepped_by_hand(integer, recurrent):
    rng = np.random.default_rng(5)
    x = (rng.random((3, 40, 12)) < 0.2).astype(np.uint8)
    layer = small_layers(rng, recurrent)[0]
    arithmetic = "integer" if integer else "ideal"
    found = prepare(layer, arithmetic).forward(rows_of(x), keep_voltage=True, count=True)
    calculus = NumpyCalculus(arithmetic)
    state = layer.population.initial_state((3, 9), calculus)
    fired = np.zeros((3, 9))
    scale, peak = (4096 if integer else 1), 0.0
    for t in range(40):
        z = x[:, t] @ layer.feed_forward.astype(np.float64)
        if recurrent:
            z = z + fired @ layer.recurrent.astype(np.float64)
        state, v, fired = layer.population.step(state, z, calculus)
        np.testing.assert_array_equal(found.voltage[:, t], v.astype(found.voltage.dtype))
        np.testing.assert_array_equal(dense(found.fired)[:, t], fired)
        np.testing.assert_array_equal(found.updates[:, t], ((v != 0) | (z != 0)).sum(axis=1))
        peak = max(peak, np.abs(state.u).max() / scale, np.abs(v).max())
    assert found.peak == peak


def test_a_sample_answers_the_same_alone_and_in_any_batch():
    rng = np.random.default_rng(6)
    x = (rng.random((5, 30, 12)) < 0.3).astype(np.uint8)
    layers = [prepare(layer, "integer") for layer in small_layers(rng, recurrent=True)]
    together = answer(rows_of(x), layers)
    for i in range(5):
        alone = answer(rows_of(x[i : i + 1]), layers)
        np.testing.assert_array_equal(alone.output[0], together.output[i])
        np.testing.assert_array_equal(alone.spikes[0], together.spikes[i])


@pytest.mark.parametrize("recurrent", [True, False])
@pytest.mark.parametrize("arithmetic", ["integer", "float32", "ideal"])
def test_gradients_agree_with_automatic_differentiation(arithmetic, recurrent):
    from dse.engine.autograd import gradients as by_autograd

    rng = np.random.default_rng(7)
    x = (rng.random((4, 25, 12)) < 0.25).astype(np.uint8)
    labels = np.array([0, 3, 1, 1])
    layers = small_layers(rng, recurrent)
    gains = [np.full((4, 1), 1.25, np.float32), 2 * (rng.random((4, 9)) < 0.5).astype(np.float32)]
    surrogates = [exponential(80 / 64, 0.03, 3.0), exponential(80 / 64, 0.1, 3.0)]
    settings = {"true_rate": 0.6, "false_rate": 0.05, "gains": gains}
    found = gradients(rows_of(x), layers, surrogates, labels, arithmetic=arithmetic, **settings)
    exact = "integer" if arithmetic == "integer" else "ideal"
    loss, feed_forward, rings = by_autograd(
        rows_of(x), layers, surrogates, labels, arithmetic=exact, **settings
    )
    assert found.loss == pytest.approx(loss, rel=1e-6)
    for ours, theirs in zip(found.feed_forward, feed_forward, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-5 * np.abs(theirs).max())
    if recurrent:
        (ring,) = rings
        np.testing.assert_allclose(found.recurrent[0], ring, rtol=0, atol=1e-5 * np.abs(ring).max())


def test_inputs_that_do_not_fit_the_layer_are_refused():
    with pytest.raises(ValueError, match=r"rows have 5 inputs, the layer has 12"):
        layer = prepare(small_layers(np.random.default_rng(0))[0], "integer")
        layer.forward(rows_of(np.ones((1, 2, 5), np.uint8)))


def test_gradients_of_a_deep_wide_stack_agree_with_automatic_differentiation():
    from dse.engine.autograd import gradients as by_autograd

    rng = np.random.default_rng(10)
    x = (rng.random((5, 30, 40)) < 0.2).astype(np.uint8)
    sizes = (40, 90, 70, 18)
    layers = [
        weights(
            fixed_point.quantise(rng.normal(0.02, 0.3, shape)),
            None,
            cuba_lif.Population(rng.integers(200, 2000, shape[1]), rng.integers(50, 500, shape[1]), 120),
        )
        for shape in pairwise(sizes)
    ]
    of_hidden = [2 * (rng.random((5, n)) < 0.5).astype(np.float32) for n in sizes[1:3]]
    gains = [np.full((5, 1), 1.25, np.float32), *of_hidden]
    labels, surrogates = rng.integers(0, 18, 5), [exponential(120 / 64, 0.03, 3.0)] * 3
    found = gradients(rows_of(x), layers, surrogates, labels, true_rate=0.6, false_rate=0.05, gains=gains)
    loss, expected, _ = by_autograd(
        rows_of(x), layers, surrogates, labels, true_rate=0.6, false_rate=0.05, gains=gains
    )
    assert found.loss == pytest.approx(loss, rel=1e-6)
    assert all(rate > 0.01 for rate in found.fired)
    for ours, theirs in zip(found.feed_forward, expected, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-5 * np.abs(theirs).max())


def test_chunks_of_samples_add_up():
    rng = np.random.default_rng(11)
    x = (rng.random((9, 1000, 12)) < 0.1).astype(np.uint8)  # four samples to a chunk
    layers, labels = small_layers(rng), rng.integers(0, 4, 9)
    settings = {"true_rate": 0.6, "false_rate": 0.05, "gains": [None, None]}
    surrogates = [exponential(80 / 64, 0.03, 3.0)] * 2
    whole = gradients(rows_of(x), layers, surrogates, labels, **settings)
    parts = [
        gradients(rows_of(x[i : i + 1]), layers, surrogates, labels[i : i + 1], **settings) for i in range(9)
    ]
    assert whole.loss == pytest.approx(sum(p.loss for p in parts))
    for depth in range(2):
        expected = sum(p.feed_forward[depth].astype(np.float64) for p in parts)
        np.testing.assert_allclose(whole.feed_forward[depth], expected, atol=1e-5 * np.abs(expected).max())


def test_gradients_of_two_heads_agree_with_automatic_differentiation():
    from dse.engine.autograd import gradients as by_autograd

    rng = np.random.default_rng(12)
    x = (rng.random((6, 25, 12)) < 0.25).astype(np.uint8)
    labels = np.stack([rng.integers(0, 3, 6), 3 + rng.integers(0, 1, 6)], axis=1)
    layers, surrogates = small_layers(rng), [exponential(80 / 64, 0.03, 3.0)] * 2
    given = {"true_rate": 0.6, "false_rate": 0.05, "gains": [None, None]}
    found = gradients(rows_of(x), layers, surrogates, labels, heads=(3, 1), **given)
    loss, expected, _ = by_autograd(rows_of(x), layers, surrogates, labels, **given)
    assert found.loss == pytest.approx(loss, rel=1e-6)
    for ours, theirs in zip(found.feed_forward, expected, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-5 * np.abs(theirs).max())
    single = gradients(rows_of(x), layers, surrogates, labels[:, 0], **given)
    assert found.correct == single.correct  # the other head has one class
    assert found.loss != single.loss


@pytest.mark.parametrize("recurrent", [True, False])
@pytest.mark.parametrize("taught", [True, False])
@pytest.mark.parametrize("loss", [SpikeRate(), CountCrossEntropy(0.4), CountCrossEntropy(0.4, read_outs=3)])
def test_every_loss_and_the_price_of_hidden_spikes_agree_with_automatic_differentiation(
    loss, taught, recurrent
):
    from dse.engine.autograd import gradients as by_autograd

    rng = np.random.default_rng(7)
    x = (rng.random((4, 25, 12)) < 0.25).astype(np.uint8)
    labels = np.array([[0, 3], [1, 3], [2, 3], [1, 3]])
    layers, surrogates = small_layers(rng, recurrent), [exponential(80 / 64, 0.03, 3.0)] * 2
    gains = [None, 2 * (rng.random((4, 9)) < 0.5).astype(np.float32)]
    given = {"true_rate": 0.6, "false_rate": 0.05, "gains": gains, "heads": (3, 1), "loss": loss}
    given["soft"] = np.column_stack([rng.dirichlet([1, 1, 1], 4), np.ones(4)]) if taught else None
    free = gradients(rows_of(x), layers, surrogates, labels, **given)
    found = gradients(rows_of(x), layers, surrogates, labels, hidden_spike_penalty=0.03, **given)
    value, feed_forward, rings = by_autograd(
        rows_of(x), layers, surrogates, labels, hidden_spike_penalty=0.03, **given
    )
    assert found.loss == pytest.approx(value, rel=1e-6)
    assert found.loss - free.loss == pytest.approx(0.03 * free.fired[0] * 4 * 25 * 9)
    for ours, theirs in zip(found.feed_forward, feed_forward, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-5 * np.abs(theirs).max())
    if recurrent:
        np.testing.assert_allclose(found.recurrent[0], rings[0], rtol=0, atol=1e-5 * np.abs(rings[0]).max())
