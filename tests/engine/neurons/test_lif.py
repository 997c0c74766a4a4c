import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.engine.neurons import cuba_lif, lif
from dse.engine.neurons.calculus import NumpyCalculus
from dse.engine.neurons.lif import Lif, State


def test_a_constant_current_is_the_closed_form():
    population = Lif(tau_m_ms=30.0, r_m=2.0, u_rest=-65.0, threshold=1e9)
    potential, spikes = lif.run(np.full((1, 50, 1), 7.0), population, 4.0)
    t_ms = 4.0 * np.arange(1, 51)
    expected = -65.0 + 14.0 * (1 - np.exp(-t_ms / 30.0))
    np.testing.assert_allclose(potential[0, :, 0], expected, rtol=1e-13)
    assert not spikes.any()


def test_the_step_is_the_solution_of_equation_1():
    """Against forward Euler of tau du/dt = u_rest - u + R I with steps of a microsecond."""
    population = Lif(tau_m_ms=5.0, r_m=3.0, u_rest=1.0, threshold=100.0)
    u = 0.5
    for _ in range(2000):
        u += 1e-3 / 5.0 * (1.0 - u + 3.0 * 2.0)
    _, found, _ = population.at(2.0).step(State(np.array(0.5)), np.array(2.0), NumpyCalculus())
    assert found == pytest.approx(u, rel=1e-4)


def test_two_half_steps_are_one_step():
    population, state = Lif(9.0, 1.5, 0.25, 50.0), State(np.array([3.0, -8.0]))
    whole, _, _ = population.at(1.0).step(state, np.array([4.0, 1.0]), NumpyCalculus())
    half, _, _ = population.at(0.5).step(state, np.array([4.0, 1.0]), NumpyCalculus())
    half, _, _ = population.at(0.5).step(half, np.array([4.0, 1.0]), NumpyCalculus())
    np.testing.assert_allclose(half.u, whole.u, rtol=1e-14)
    assert state.u.tolist() == [3.0, -8.0], "a state is never changed"


def test_spikes_above_the_threshold_and_resets_to_rest():
    population = Lif(tau_m_ms=1 / math.log(2), r_m=2.0, u_rest=-1.0, threshold=1.0)  # k = 1/2, (1 - k) R = 1
    potential, spikes = lif.run(np.array([2.0, 2.0, 0.5, 0.0])[None, :, None], population, 1.0)
    # u = 1 does not fire; from 1: 0 + 2 = 2 fires; from rest -1: -0.5; then -0.75.
    np.testing.assert_allclose(potential[0, :, 0], [1.0, 2.0, -0.5, -0.75], rtol=1e-15)
    assert spikes[0, :, 0].tolist() == [False, True, False, False]


@given(
    keep=st.integers(0, 4095),
    z=st.lists(st.integers(-64, 128).map(lambda x: x / 32), min_size=1, max_size=40),
    threshold=st.integers(1, 300),
)
def test_it_is_a_cuba_lif_neuron_without_current_memory(keep, z, threshold):
    current = np.array(z)[None, :, None]
    decay = np.array([4096 - keep], np.int32)
    chip = cuba_lif.Population(np.array([4096], np.int32), decay, threshold)
    _, voltage, spikes = cuba_lif.run(current, chip, "ideal")
    tau_m_ms = -1.0 / math.log(keep / 4096) if keep else 1e-3
    own = Lif(tau_m_ms, 1 / lif.leak(1.0, tau_m_ms), 0.0, threshold / 64)
    potential, found = lif.run(current, own, 1.0)
    close = np.abs(voltage - threshold / 64) < 1e-9  # rounding may decide these, and all that follows
    until = int(close[0, :, 0].argmax()) if close.any() else len(z)
    np.testing.assert_allclose(potential[:, :until], voltage[:, :until], rtol=1e-9, atol=1e-12)
    assert np.array_equal(found[:, :until], spikes[:, :until])


@pytest.mark.parametrize("tau_m_ms", [5e-324, 1e-320, 1e-9])
def test_without_memory_the_potential_is_the_drive(tau_m_ms):
    potential, _ = lif.run(np.array([3.0, 0.0, -2.0])[None, :, None], Lif(tau_m_ms, 2.0, 0.0, 50.0), 1.0)
    assert potential[0, :, 0].tolist() == [6.0, 0.0, -4.0]


def test_an_endless_memory_adds_up():
    potential, _ = lif.run(np.ones((1, 1000, 1)), Lif(1e12, 1e12, 0.0, 1e9), 1.0)
    np.testing.assert_allclose(potential[0, :, 0], np.arange(1.0, 1001.0), rtol=1e-8)


def test_a_huge_current_saturates_and_is_forgotten():
    huge = np.array([1e308, -1e308, 1.7e308, 1e308])[None, :, None]
    potential, spikes = lif.run(huge, Lif(1e-3, 1e300, 0.0, 1.0), 1.0)
    assert potential[0, :, 0].tolist() == [1e300, -1e300, 1e300, 1e300]
    assert spikes[0, :, 0].tolist() == [True, False, True, True]
    slow, _ = lif.run(np.full((1, 100, 1), -1e308), Lif(50.0, 1e300, 0.0, 1.0), 1.0)
    assert np.isfinite(slow).all() and (np.diff(slow[0, :, 0]) < 0).all()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_current_that_is_no_number_is_refused(bad):
    with pytest.raises(ValueError, match=f"current must be finite, got {bad}"):
        lif.run(np.array([1.0, bad])[None, :, None], Lif(1.0), 1.0)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"tau_m_ms": 0.0}, "tau_m_ms must be > 0, got 0.0"),
        ({"tau_m_ms": -1.0}, "tau_m_ms must be > 0"),
        ({"tau_m_ms": np.nan}, "tau_m_ms must be finite"),
        ({"tau_m_ms": 1.0, "threshold": np.inf}, "threshold must be finite"),
        ({"tau_m_ms": 1.0, "threshold": -70.0, "u_rest": -65.0}, "threshold must be above u_rest"),
    ],
)
def test_parameters_that_make_no_neuron(keys, message):
    with pytest.raises(ValueError, match=message):
        Lif(**keys)
    with pytest.raises(ValueError, match="must be > 0"):
        lif.leak(0.0, 1.0)
