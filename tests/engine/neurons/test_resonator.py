"""Resonators: golden vectors of plain integers, cases by hand, and what their factors promise."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.engine.neurons import LayerSpec, cuba_lif, resonator
from dse.engine.neurons.calculus import NumpyCalculus
from dse.engine.neurons.resonator import Population, Resonator, State, backward, factors

GOLDEN = json.loads((Path(__file__).parent.parent.parent / "golden" / "resonator.json").read_text())
CASES = GOLDEN["cases"]


def population(c, s, *, reset=False, threshold=80):
    """Return resonators alone."""
    c = np.atleast_1d(np.asarray(c, np.int32))
    none = np.zeros_like(c)
    return Population(c >= -4096, c, np.broadcast_to(np.int32(s), c.shape), none, none, threshold, reset)


def run(z, of, arithmetic):
    """Return x, y before reset and spikes of (step, neuron) input in weight units."""
    calculus = NumpyCalculus(arithmetic)
    state = of.initial_state((z.shape[1],), calculus)
    seen = []
    for drive in z:
        state, potential, spikes = of.step(state, drive, calculus)
        seen.append((state.x, potential, spikes))
    x, y, spikes = (np.array(part) for part in zip(*seen, strict=True))
    return x, y, spikes


def test_the_golden_vectors():
    periods, qualities = (np.array([case[key] for case in CASES]) for key in ("period", "quality"))
    c, s = factors(periods, qualities)
    np.testing.assert_array_equal([c, s], [[case[key] for case in CASES] for key in ("c", "s")])
    z = np.array([case["z"] for case in CASES]).T / 4096
    for reset in (False, True):
        of = population(c, s, reset=reset, threshold=GOLDEN["threshold"])
        x, y, spikes = run(z, of, "integer")
        expected = [case["reset" if reset else "free"] for case in CASES]
        np.testing.assert_array_equal(x.T, [case["x"] for case in expected])
        np.testing.assert_array_equal(y.T * 4096, [case["y"] for case in expected])
        np.testing.assert_array_equal(spikes.T, [case["spikes"] for case in expected])
    g = np.array([case["g"] for case in CASES], np.float64).T[None]
    by_z = backward(g, np.ones_like(g), population(c, s))
    np.testing.assert_allclose(by_z[0].T, [case["by_z"] for case in CASES], rtol=1e-9, atol=1e-9)


def test_four_steps_by_hand():
    # Period 4, r = 1/2: c = 0, s = 2048; 3 weight units become y = 3/2, x = -3/4, y = -3/8.
    x, y, spikes = run(np.array([[3.0], [0], [0], [0]]), population(0, 2048), "ideal")
    np.testing.assert_array_equal(x[:, 0], [3, 0, -0.75, 0])
    np.testing.assert_array_equal(y[:, 0], [0, 1.5, 0, -0.375])
    np.testing.assert_array_equal(spikes[:, 0], [0, 1, 0, 0])
    x, y, _ = run(np.array([[3.0], [0], [0], [0]]), population(0, 2048, reset=True), "ideal")
    np.testing.assert_array_equal([x[2:, 0], y[2:, 0]], np.zeros((2, 2)))  # x was 0 when y was reset


def test_truncation_is_toward_zero_and_equality_does_not_fire():
    of, calculus = population([0, -1], 1, threshold=64), NumpyCalculus("integer")
    state = State(np.array([-4097, 4097]), np.array([0, 0]))
    (x, y), _, _ = of.step(state, np.zeros(2), calculus)
    assert x.tolist() == [0, -1] and y.tolist() == [-1, 1]
    state = State(np.array([4096 * 4096] * 2), np.array([0, 0]))
    _, potential, spikes = of.step(state, np.zeros(2), calculus)
    assert potential.tolist() == [1, 1] and spikes.tolist() == [0, 0]


def test_an_answer_is_a_damped_sine():
    period, quality = 16.0, 4.0
    c, s = factors(period, quality)
    z = np.zeros((60, 1))
    z[0] = 1
    _, y, _ = run(z, population(c, s), "ideal")
    t = np.arange(60)
    r = np.exp(-np.pi / (quality * period))
    np.testing.assert_allclose(y[:, 0], r**t * np.sin(2 * np.pi * t / period), atol=5e-3)


@given(
    period=st.floats(2, 1e7),
    quality=st.floats(1e-6, 1e7),
    z=st.lists(st.integers(-(2**18), 2**18), min_size=1, max_size=20),
)
def test_no_state_outgrows_the_summed_input(period, quality, z):
    c, s = factors(period, quality)
    assert int(c) ** 2 + int(s) ** 2 < 4096**2 and s >= 1
    x, y, _ = run(np.array(z)[:, None] / 4096, population(c, s, threshold=2**30), "integer")
    total = np.cumsum(np.abs(z))
    assert (np.hypot(x[:, 0], y[:, 0] * 4096) <= total * (1 + 1e-12)).all()


def test_silence_ends_at_exactly_zero():
    c, s = factors(np.array([2.2, 5.0, 40.0, 300.0]), 5.0)
    z = np.zeros((9000, 4))
    z[0] = 3.97
    x, y, _ = run(z, population(c, s), "integer")
    assert (x[-1] == 0).all() and (y[-1] == 0).all()


def test_neurons_that_do_not_resonate_are_cuba_lif():
    rng = np.random.default_rng(0)
    layer = LayerSpec(n_neurons=8, is_output=False, steps_per_sample=2, step_ms=1.0)
    mixed = Resonator(share=0.5, period=(3, 10)).population(layer, rng)
    assert mixed.resonates.tolist() == [True] * 4 + [False] * 4
    lif = cuba_lif.Population(mixed.decay_current[4:], mixed.decay_voltage[4:], mixed.threshold)
    z = rng.integers(-64, 96, (1, 50, 8)) / 32
    for arithmetic in ("integer", "ideal"):
        _, y, spikes = run(z[0], mixed, arithmetic)
        _, v, fired = cuba_lif.run(z[..., 4:], lif, arithmetic)
        np.testing.assert_array_equal(y[:, 4:], v[0])
        np.testing.assert_array_equal(spikes[:, 4:], fired[0])
        assert 0 < spikes[:, :4].sum() != spikes[:, 4:].sum() > 0


def test_periods_in_ms_and_hz_are_those_in_steps():
    layer = LayerSpec(n_neurons=300, is_output=False, steps_per_sample=2, step_ms=2.0)
    of = {
        unit: Resonator(period=bounds, period_unit=unit).population(layer, np.random.default_rng(1))
        for unit, bounds in (("steps", (2.5, 40)), ("ms", (10, 160)), ("Hz", (6.25, 100)))
    }
    for unit in ("ms", "Hz"):
        for name in ("cosine", "sine"):
            np.testing.assert_array_equal(getattr(of[unit], name), getattr(of["steps"], name))
    angle = np.arctan2(of["steps"].sine, of["steps"].cosine)
    period = 2 * np.pi / angle / 2  # in input steps of two network steps
    assert 2.4 < period.min() < 3 and 30 < period.max() < 41
    output = Resonator().population(LayerSpec(3, True, 1, 1.0), np.random.default_rng(0))
    assert type(output) is cuba_lif.Population


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({"period": (1.5, 40)}, "period must be at least 2 input steps, got 1.5"),
        ({"period": (40, 2.2)}, r"period must have bounds in increasing order, got \[40, 2.2\]"),
        ({"quality": (5, 1.5)}, r"quality must have bounds in increasing order, got \[5, 1.5\]"),
        ({"period": (2, 3, 4)}, "period must be one number or two bounds, got 3 numbers"),
        ({"quality": ()}, "quality must be one number or two bounds, got 0 numbers"),
    ],
)
def test_bad_bounds(keys, sentence):
    with pytest.raises(ValueError, match=sentence):
        Resonator(**keys)


@pytest.mark.parametrize(("unit", "bounds", "got"), [("ms", (7, 90), "7 ms"), ("Hz", (1, 200), "200 Hz")])
def test_periods_that_the_steps_of_a_layer_cannot_hold(unit, bounds, got):
    layer = LayerSpec(n_neurons=4, is_output=False, steps_per_sample=2, step_ms=2.0)
    with pytest.raises(ValueError, match=f"period must be at least 2 input steps of 4 ms, got {got}"):
        Resonator(period=bounds, period_unit=unit).population(layer, np.random.default_rng(0))


def test_the_definition_counts_a_turning_state_as_an_update():
    x, y = np.array([5, 0, 0]), np.array([0, 0, 7])
    assert population([1, 1, 1], 1).awake(resonator.State(x, y)).tolist() == [True, False, False]
