"""Layers run and trained by the definition of their neurons, against the kernels."""

import numpy as np
import pytest

from benchmarks.ours import rows_of
from dse.engine import cpu
from dse.engine.definition import DefinedLayer
from dse.engine.engines import start
from dse.engine.events import dense
from dse.engine.layers import prepare, weights
from dse.engine.member import Masters, Member, TrainedLayer, Turn
from dse.engine.neurons import cuba_lif
from dse.engine.neurons.fixed_point import quantise
from dse.engine.neurons.lif import Lif
from dse.engine.neurons.surrogate import exponential

N_IN, N_HIDDEN, N_OUT = 12, 9, 4


def population(rng, n):
    decays = (rng.integers(100, 3000, n).astype(np.int32) for _ in range(2))
    return cuba_lif.Population(*decays, 80)


def member(arithmetic, *, ring, clip_norm=None):
    rng = np.random.default_rng(3)
    layers = []
    for n_in, n in ((N_IN, N_HIDDEN), (N_HIDDEN, N_OUT)):
        recurrent = rng.normal(0, 0.3, (n, n)).astype(np.float32) if ring and n == N_HIDDEN else None
        layers.append(
            TrainedLayer(
                feed_forward=rng.normal(0.15, 0.5, (n_in, n)).astype(np.float32),
                recurrent=recurrent,
                population=population(rng, n),
                surrogate=exponential(80 / 64, 0.03, 3.0),
                unit=rng.uniform(0.5, 1.5, n).astype(np.float32),
                recurrent_unit=None if recurrent is None else np.full(n, 0.7, np.float32),
            )
        )
    return Member(tuple(layers), 0.6, 0.05, arithmetic, clip_norm)


@pytest.mark.parametrize("recurrent", [False, True])
@pytest.mark.parametrize("arithmetic", ["integer", "ideal"])
def test_a_definition_answers_bit_for_bit_as_its_kernel(arithmetic, recurrent):
    rng = np.random.default_rng(5)
    x = (rng.random((3, 2100, N_IN)) < 0.1).astype(np.uint8)  # two chunks
    ring = quantise(rng.normal(0, 0.4, (N_HIDDEN, N_HIDDEN))) if recurrent else None
    layer = weights(quantise(rng.normal(0.1, 0.5, (N_IN, N_HIDDEN))), ring, population(rng, N_HIDDEN))
    by_kernel = prepare(layer, arithmetic).forward(rows_of(x), keep_voltage=True, count=True)
    by_definition = DefinedLayer(layer, arithmetic).forward(rows_of(x), keep_voltage=True, count=True)
    np.testing.assert_array_equal(dense(by_definition.fired), dense(by_kernel.fired))
    kind = by_kernel.voltage.dtype
    np.testing.assert_array_equal(by_definition.voltage.astype(kind), by_kernel.voltage)
    np.testing.assert_array_equal(by_definition.updates, by_kernel.updates)
    assert by_definition.peak == by_kernel.peak


@pytest.mark.parametrize("arithmetic", ["float32", "ideal"])
def test_a_sample_answers_the_same_alone_and_in_any_batch(arithmetic):
    rng = np.random.default_rng(6)
    x = (rng.random((5, 40, N_IN)) < 0.3).astype(np.uint8)
    ring = rng.normal(0, 0.4, (N_HIDDEN, N_HIDDEN))
    layer = DefinedLayer(
        weights(rng.normal(0.1, 0.5, (N_IN, N_HIDDEN)), ring, Lif(tau_m_ms=30.0).at(2.0)), arithmetic
    )
    together = layer.forward(rows_of(x), keep_voltage=True)
    assert 0 < together.fired.index.size < x.shape[0] * x.shape[1] * N_HIDDEN
    for i in range(5):
        alone = layer.forward(rows_of(x[i : i + 1]), keep_voltage=True)
        np.testing.assert_array_equal(alone.voltage[0], together.voltage[i])
        np.testing.assert_array_equal(dense(alone.fired)[0], dense(together.fired)[i])


@pytest.mark.parametrize("ring", [False, True])
@pytest.mark.parametrize("arithmetic", ["integer", "float32", "ideal"])
def test_automatic_differentiation_trains_as_the_kernels_do(arithmetic, ring):
    from dse.engine import autograd  # and with it torch

    rng = np.random.default_rng(7)
    x, labels = (rng.random((6, 30, N_IN)) < 0.25).astype(np.uint8), rng.integers(0, N_OUT, 6)
    of = member(arithmetic, ring=ring, clip_norm=0.05)
    engines = [autograd.start([of]), cpu.start([of], 6, 30)]
    kept = Masters(
        tuple(rng.random(layer.feed_forward.shape) < 0.7 for layer in of.layers),
        tuple(None if x.recurrent is None else rng.random(x.recurrent.shape) < 0.7 for x in of.layers),
    )
    for step in range(3):
        if step == 1:
            for engine in engines:
                engine.prune(0, kept)
        gains = (np.full((6, 1), 1.25, np.float32), 2 * (rng.random((6, N_HIDDEN)) < 0.5).astype(np.float32))
        turns = {0: Turn(1e-3, gains)}
        (slow,), (fast,) = (engine.step(rows_of(x), labels, turns).values() for engine in engines)
        assert slow.loss == pytest.approx(fast.loss, rel=1e-6)
        assert (slow.correct, slow.fired) == (fast.correct, pytest.approx(fast.fired))
        assert slow.gradient_norm == pytest.approx(fast.gradient_norm, rel=1e-4)
    masters = (engine.masters(0) for engine in engines)
    for a, b in zip(*([*of.feed_forward, *of.recurrent] for of in masters), strict=True):
        assert (a is None) == (b is None)
        if a is not None and b is not None:
            np.testing.assert_allclose(a, b, rtol=0, atol=2e-5)
            np.testing.assert_array_equal(a == 0, b == 0)


def test_chunks_of_samples_add_up(monkeypatch):
    from dse.engine import autograd  # and with it torch

    rng = np.random.default_rng(8)
    x, labels = (rng.random((5, 20, N_IN)) < 0.3).astype(np.uint8), rng.integers(0, N_OUT, 5)
    of = member("ideal", ring=True)
    reports = []
    for rows in (10_000, 40):  # all samples at a time, two at a time
        monkeypatch.setattr(autograd, "DIFFERENTIATED_ROWS", rows)
        engine = autograd.start([of])
        reports += engine.step(rows_of(x), labels, {0: Turn(0.01, (None, None))}).values()
    assert reports[0].loss == pytest.approx(reports[1].loss)
    assert reports[0].gradient_norm == pytest.approx(reports[1].gradient_norm)
    assert (reports[0].correct, reports[0].fired) == (reports[1].correct, reports[1].fired)


def test_neurons_without_a_kernel_need_torch(monkeypatch):
    layer = TrainedLayer(
        feed_forward=np.ones((2, 2), np.float32),
        recurrent=None,
        population=Lif().at(1.0),
        surrogate=exponential(1.0, 0.03, 3.0),
        unit=np.ones(2, np.float32),
    )
    monkeypatch.setattr("dse.base.native.extras.find_spec", lambda name: None)
    message = r"training neurons without a kernel needs torch: pip install 'dse-spiking\[torch\]'"
    with pytest.raises(RuntimeError, match=message):
        start([Member((layer,), 0.6, 0.05, "ideal")], 1, 1)
