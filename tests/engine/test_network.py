"""The engine against golden vectors and against the equations of dse.neurons."""

from __future__ import annotations

import numpy as np
import pytest

from dse.engine.events import Rows, delayed, dense
from dse.engine.layers import Weights, forward, weights
from dse.engine.network import answer, gradients
from dse.neurons import cuba_lif
from dse.neurons.surrogate import exponential
from tests.golden import Case, cases


def rows_of(x: np.ndarray) -> Rows:
    """Return (sample, step, channel) 0/1 as rows."""
    n, t, c = x.shape
    flat = x.reshape(n * t, c) != 0
    offsets = np.concatenate([[0], np.cumsum(flat.sum(axis=1))]).astype(np.int64)
    return Rows(offsets, np.nonzero(flat)[1].astype(np.int32), n, t, c)


@pytest.mark.parametrize("case", cases())
def test_the_engine_is_golden(case: Case) -> None:
    given = case.settings["params"]
    population = cuba_lif.params(given["current_decay"], given["voltage_decay"], given["threshold"])
    raw = [case.given(f"w{k}") for k in range(1, case.n_layers + 1)]
    used = [cuba_lif.quantise(w) if case.mode == "quant" else w for w in raw]
    layers = [
        weights(w.T, None, population.decay_current, population.decay_voltage, population.threshold)
        for w in used
    ]
    rows, shifts = rows_of(case.given("x")), case.settings["delay_shift"]
    inputs = rows
    for depth, layer in enumerate(layers, 1):
        done = forward(inputs, layer, arithmetic="integer" if case.integer else "ideal", keep_voltage=True)
        np.testing.assert_array_equal(dense(done.fired), case.expected(f"spk{depth}"))
        golden = case.state("vol", depth)
        np.testing.assert_array_equal(done.voltage, golden.astype(done.voltage.dtype))
        inputs = delayed(done.fired) if shifts else done.fired
    np.testing.assert_array_equal(dense(inputs), case.expected("out"))

    surrogate = exponential(population.threshold, given["tau_grad"], given["scale_grad"])
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
        passes = cuba_lif.quantise_passes(raw[depth - 1]) if case.mode == "quant" else 1
        golden = case.expected(f"grad_w{depth}")
        bound = 1e-5 * max(np.abs(golden).max(), 1e-30)
        np.testing.assert_allclose(by_weight.T * passes, golden, rtol=0, atol=bound)


def small_layers(rng: np.random.Generator, recurrent: bool = False) -> list[Weights]:
    """Return a 12-9-4 stack on the 8-bit grid with a decay of its own per neuron."""
    layers = []
    for n_in, n_out in ((12, 9), (9, 4)):
        ring = cuba_lif.quantise(rng.normal(0, 0.4, (n_out, n_out))) if recurrent and n_out == 9 else None
        layers.append(
            weights(
                cuba_lif.quantise(rng.normal(0.1, 0.5, (n_in, n_out))),
                ring,
                rng.integers(0, 4097, n_out),
                rng.integers(0, 4097, n_out),
                80,
            )
        )
    return layers


def population_of(layer: Weights) -> cuba_lif.Params:
    decays = [(4096 - 4096 * keep).astype(np.int32) for keep in (layer.keep_current, layer.keep_voltage)]
    return cuba_lif.Params(decays[0], decays[1], layer.threshold)


@pytest.mark.parametrize("integer", [True, False])
@pytest.mark.parametrize("recurrent", [True, False])
def test_states_equal_the_definition_stepped_by_hand(integer: bool, recurrent: bool) -> None:
    rng = np.random.default_rng(5)
    x = (rng.random((3, 40, 12)) < 0.2).astype(np.uint8)
    layer = small_layers(rng, recurrent)[0]
    found = forward(
        rows_of(x), layer, arithmetic="integer" if integer else "ideal", keep_voltage=True, count=True
    )
    state = cuba_lif.initial_state((3, 9), "integer" if integer else "ideal")
    fired = np.zeros((3, 9), bool)
    scale, peak = (4096 if integer else 1), 0.0
    for t in range(40):
        z = x[:, t] @ layer.feed_forward.astype(np.float64)
        if recurrent:
            z = z + fired @ layer.recurrent.astype(np.float64)
        state, v, fired = cuba_lif.step(state, z, population_of(layer))
        np.testing.assert_array_equal(found.voltage[:, t], (v / scale).astype(found.voltage.dtype))
        np.testing.assert_array_equal(dense(found.fired)[:, t], fired)
        np.testing.assert_array_equal(found.updates[:, t], ((v != 0) | (z != 0)).sum(axis=1))
        peak = max(peak, np.abs(state.u).max() / scale, np.abs(v).max() / scale)
    assert found.peak == peak


def test_a_sample_answers_the_same_alone_and_in_any_batch() -> None:
    rng = np.random.default_rng(6)
    x = (rng.random((5, 30, 12)) < 0.3).astype(np.uint8)
    layers = small_layers(rng, recurrent=True)
    together = answer(rows_of(x), layers, arithmetic="integer")
    for i in range(5):
        alone = answer(rows_of(x[i : i + 1]), layers, arithmetic="integer")
        np.testing.assert_array_equal(alone.output[0], together.output[i])
        np.testing.assert_array_equal(alone.spikes[0], together.spikes[i])


@pytest.mark.parametrize("recurrent", [True, False])
@pytest.mark.parametrize("integer", [True, False])
def test_gradients_agree_with_automatic_differentiation(integer: bool, recurrent: bool) -> None:
    from benchmarks.torch_loop import gradients as by_autograd

    rng = np.random.default_rng(7)
    x = (rng.random((4, 25, 12)) < 0.25).astype(np.uint8)
    labels = np.array([0, 3, 1, 1])
    layers = small_layers(rng, recurrent)
    gains = [None, 2 * (rng.random((4, 9)) < 0.5).astype(np.float32)]
    surrogates = [exponential(80, 0.03, 3.0), exponential(80, 0.1, 3.0)]
    found = gradients(
        rows_of(x),
        layers,
        surrogates,
        labels,
        true_rate=0.6,
        false_rate=0.05,
        arithmetic="integer" if integer else "ideal",
        gains=gains,
    )
    loss, feed_forward, ring = by_autograd(x, layers, surrogates, labels, 0.6, 0.05, integer, gains)
    assert found.loss == pytest.approx(loss, rel=1e-6)
    for ours, theirs in zip(found.feed_forward, feed_forward, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-5 * np.abs(theirs).max())
    if recurrent:
        assert ring is not None
        np.testing.assert_allclose(found.recurrent[0], ring, rtol=0, atol=1e-5 * np.abs(ring).max())


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
def test_extreme_inputs_run_and_give_finite_gradients(x: np.ndarray) -> None:
    layers = small_layers(np.random.default_rng(8))
    labels = np.zeros(len(x), np.int64)
    found = gradients(
        rows_of(x),
        layers,
        [exponential(80, 0.03, 3.0)] * 2,
        labels,
        true_rate=0.8,
        false_rate=0.0,
        arithmetic="integer",
        gains=[None, None],
    )
    assert np.isfinite(found.loss) and all(np.isfinite(g).all() for g in found.feed_forward)
    if not x.any():
        assert all((g == 0).all() for g in found.feed_forward)


def test_a_state_beyond_24_bits_is_reported() -> None:
    layer = weights(np.full((12, 1), 3.5, np.float32), None, np.int32(0), np.int32(0), 131071)
    done = forward(rows_of(np.ones((1, 100, 12), np.uint8)), layer, arithmetic="integer", count=True)
    assert done.peak * 4096 > cuba_lif.STATE_LIMIT


def test_inputs_that_do_not_fit_the_layer_are_refused() -> None:
    with pytest.raises(ValueError, match=r"rows have 5 inputs, the layer expects 12"):
        forward(
            rows_of(np.ones((1, 2, 5), np.uint8)),
            small_layers(np.random.default_rng(0))[0],
            arithmetic="integer",
        )
