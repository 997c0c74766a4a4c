import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.engine.neurons.izhikevich import (
    FA,
    FLOOR_MV,
    METHODS,
    PEAK_MV,
    SA,
    Params,
    State,
    initial_state,
    reference,
    simulate,
    step,
)

KINDS = [SA, FA]


def test_two_steps_by_hand():
    # v' = 0.04 65^2 - 325 + 140 + 13 + 10 = 7, u' = 0.02 (-13 + 13) = 0; then from v = -58, u = -13
    state, spiked = step(initial_state((1,), SA), np.array([10.0]), SA)
    assert (state.v[0], state.u[0], spiked[0]) == (pytest.approx(-58.0), -13.0, False)
    state, _ = step(state, np.array([10.0]), SA)
    assert state.v[0] == pytest.approx(-58 + 0.04 * 58**2 - 290 + 140 + 13 + 10)
    assert state.u[0] == pytest.approx(-13 + 0.02 * (-11.6 + 13))


def test_half_steps_by_hand():
    state, _ = step(initial_state((1,), SA), np.array([10.0]), SA, method="half_steps")
    half = -65 + 0.5 * 7.0
    v = half + 0.5 * (0.04 * half**2 + 5 * half + 140 + 13 + 10)
    assert state.v[0] == pytest.approx(v)
    assert state.u[0] == pytest.approx(-13 + 0.02 * (0.2 * v + 13))  # adaptation sees the new v


def test_a_spike_resets_v_and_raises_u():
    before = State(np.array([29.0, PEAK_MV - 1e-9, 0.0]), np.array([-13.0, 400.0, -13.0]))
    after, spiked = step(before, np.zeros(3), FA)
    assert spiked.tolist() == [True, False, True]
    assert after.v[0] == -65.0
    assert after.u[0] == pytest.approx(-13 + 0.1 * (0.2 * 29 + 13) + 2)
    assert before.v[0] == 29.0, "the state that came in is unchanged"


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("params", KINDS)
def test_silent_without_current_and_with_a_negative_one(params, method):
    for current in (0.0, -1.0, -1e6, -np.inf):
        assert not simulate(np.full((500, 1), current), params, method=method).any()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("params", KINDS)
@pytest.mark.parametrize("current", [1e4, 1e6, 1e12, 1e300, np.inf])
def test_a_huge_current_makes_one_spike_per_step(params, method, current):
    assert simulate(np.full((300, 1), current), params, method=method).all()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("params", KINDS)
def test_silent_again_once_a_huge_current_is_gone(params, method):
    current = np.concatenate([np.full((200, 1), 1e6), np.zeros((2000, 1))])
    assert not simulate(current, params, method=method)[201:].any()


@pytest.mark.parametrize("method", METHODS)
@given(
    current=st.lists(st.floats(-1e308, 1e308), min_size=1, max_size=60), params=st.sampled_from(KINDS)
)  # fmt: skip
def test_states_stay_within_their_bounds(method, current, params):
    state = initial_state((1,), params)
    for now in current:
        state, _ = step(state, np.array([now]), params, method=method)
        assert FLOOR_MV <= state.v[0] < PEAK_MV
        assert np.abs(state.u[0]) < 500


def test_more_current_more_spikes():
    current = np.tile(np.array([4.0, 6.0, 10.0, 20.0, 40.0, 80.0]), (1000, 1))
    for params in KINDS:
        counts = simulate(current, params).sum(axis=0)
        assert (np.diff(counts) > 0).all()
    # Regular spiking adapts: its first interval is its shortest.
    intervals = np.diff(np.flatnonzero(simulate(np.full((1000, 1), 10.0), SA)))
    assert intervals[0] < intervals[-1]


@pytest.mark.parametrize("params", KINDS)
@pytest.mark.parametrize("current", [10.0, 25.0])
def test_smaller_steps_come_closer_to_the_reference(params, current):
    n_ms = 120
    exact = reference(np.array([current]), params, step_ms=n_ms)
    off = []
    for step_ms in (1.0, 0.1, 0.02):
        n = round(n_ms / step_ms)
        times = (np.flatnonzero(simulate(np.full((n, 1), current), params, step_ms)) + 1) * step_ms
        off.append((abs(times[0] - exact[0]), abs(len(times) - len(exact))))
    first, count = zip(*off, strict=True)
    assert first[2] <= first[1] <= first[0]
    assert first[2] <= 0.1 * first[0]
    assert count[2] <= min(1, count[0])


def test_the_reference_is_silent_without_current_and_agrees_with_itself():
    assert reference(np.zeros(100), SA).size == 0
    coarse, fine = (reference(np.array([20.0]), FA, 100.0, x) for x in (1e-6, 1e-10))
    assert len(fine) > 3
    assert np.abs(coarse - fine).max() < 1e-3
    # A current held over steps of 5 ms is the same current.
    assert np.allclose(reference(np.full(20, 20.0), FA, step_ms=5.0), fine, atol=1e-5)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda s: step(s, np.array([np.nan]), SA), "current must be numbers, got NaN in 1 places"),
        (lambda s: step(s, np.zeros(1), SA, 0.0), "step_ms must be > 0, got 0"),
        (lambda s: step(s, np.zeros(1), SA, method="rk4"), "method must be one of euler, half_steps, got"),
        (lambda s: reference(np.array([np.inf]), SA), "current must be finite, got 1 other values"),
    ],
)
def test_wrong_calls(call, message):
    with pytest.raises(ValueError, match=message):
        call(initial_state((1,), SA))


def test_parameters_may_differ_by_neuron():
    both = Params(*(np.array([getattr(SA, x), getattr(FA, x)]) for x in "abcd"))
    current = np.full((400, 2), 20.0)
    found = simulate(current, both)
    for k, params in enumerate(KINDS):
        assert np.array_equal(found[:, k], simulate(current[:, k : k + 1], params)[:, 0])
