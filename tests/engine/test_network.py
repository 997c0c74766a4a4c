"""The engine against golden vectors and against the equations of dse.neurons."""

from __future__ import annotations

import numpy as np
import pytest

from dse.engine import cpu
from dse.engine.events import Rows
from dse.engine.network import gradients
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
        cpu.weights(w.T, None, population.decay_current, population.decay_voltage, population.threshold)
        for w in used
    ]
    rows, shifts = rows_of(case.given("x")), case.settings["delay_shift"]
    inputs = rows
    for depth, layer in enumerate(layers, 1):
        done = cpu.forward(inputs, layer, integer=case.integer, keep_voltage=True)
        np.testing.assert_array_equal(cpu.dense(done.fired), case.expected(f"spk{depth}"))
        golden = case.state("vol", depth)
        np.testing.assert_array_equal(done.voltage, golden.astype(done.voltage.dtype))
        inputs = cpu.delayed(done.fired) if shifts else done.fired
    np.testing.assert_array_equal(cpu.dense(inputs), case.expected("out"))

    surrogate = exponential(population.threshold, given["tau_grad"], given["scale_grad"])
    found = gradients(
        rows,
        layers,
        [surrogate] * len(layers),
        case.given("labels"),
        true_rate=case.settings["true_rate"],
        false_rate=case.settings["false_rate"],
        integer=case.integer,
        gains=[None] * len(layers),
        shift=shifts,
    )
    assert found.loss == pytest.approx(float(case.expected("loss")), rel=1e-6, abs=1e-12)
    for depth, by_weight in enumerate(found.feed_forward, 1):
        passes = cuba_lif.quantise_passes(raw[depth - 1]) if case.mode == "quant" else 1
        golden = case.expected(f"grad_w{depth}")
        bound = 1e-5 * max(np.abs(golden).max(), 1e-30)
        np.testing.assert_allclose(by_weight.T * passes, golden, rtol=0, atol=bound)
