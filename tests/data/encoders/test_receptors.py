import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.base.records import Signals
from dse.data.encoders.receptors import Receptors, parameters
from dse.engine.neurons import izhikevich
from dse.engine.neurons.izhikevich import FA, METHODS, SA, Params
from tests.data.encoders import plain
from tests.data.encoders.plain import recorded


def one(values, step_ms=10.0):
    return recorded(values, step_ms=step_ms)


def encoded(encoder, values, step_ms=10.0):
    return plain.encoded(encoder, one(values, step_ms))[0]


def learnt(encoder, signals, train):
    n_steps = int(np.diff(signals.offsets).min())
    n = signals.n_recordings
    return encoder.fitted(signals, np.zeros(n, np.int64), n_steps, np.zeros(n, np.int64), 1, train)


def wave(n_steps=80, n=3, seed=0):
    rng = np.random.default_rng(seed)
    return np.cumsum(rng.normal(0, 4, (n_steps, n)), axis=0).astype(np.float32) + 100


UNIT = Receptors(low=(0.0, 0.0, 0.0), high=(1.0, 1.0, 1.0))


def test_currents_by_hand():
    encoder = Receptors(gain=2.0, gain_sa=50.0, gain_fa=5.0, low=(10.0, 0.0), high=(20.0, 4.0))
    found = encoder.currents(np.array([[10.0, 4.0], [15.0, 4.0], [12.5, 0.0]]), 100.0)
    # V = 0 1/2 1/4 and 1 1 0; dV/dt = 0 5 -2.5 and 0 0 -10 per s
    assert found.tolist() == [[0, 100, 0, 0, 0, 0], [50, 100, 50, 0, 0, 0], [25, 0, 0, 0, 25, 100]]
    no_level = dataclasses.replace(encoder, sa=False)
    assert no_level.currents(np.array([[10.0, 4.0], [15.0, 4.0]]), 100.0).tolist() == [[0] * 4, [50, 0, 0, 0]]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("sa", [True, False])
@given(
    seed=st.integers(0, 10_000), step_ms=st.sampled_from([0.5, 1.0, 3.3, 10.0]), copies=st.integers(1, 4),
    gain=st.sampled_from([0.3, 3.0, 1e6]),
)  # fmt: skip
def test_the_fast_path_is_the_definition(method, sa, seed, step_ms, copies, gain):
    values = wave(20, 2, seed)
    encoder = Receptors(gain=gain, sa=sa, spikes_per_step=copies, method=method)
    encoder = learnt(encoder, one(values, step_ms), np.array([0]))
    current = encoder.currents(values.astype(np.float64), step_ms)
    params = Params(*np.repeat(parameters(sa), 2, axis=0).T)
    n = encoder.solver_steps(step_ms)  # steps of the neurons, within which the current is constant
    fired = izhikevich.simulate(np.repeat(current, n, axis=0), params, step_ms / n, method)
    fired = fired.reshape(len(current), n, -1).sum(axis=1)
    expected = np.concatenate([fired > j for j in range(copies)], axis=1)
    assert np.array_equal(encoded(encoder, values, step_ms), expected)


def test_kinds_are_those_of_the_source():
    assert parameters(True).tolist() == [[SA.a, SA.b, SA.c, SA.d]] + 2 * [[FA.a, FA.b, FA.c, FA.d]]
    assert parameters(False).tolist() == 2 * [[FA.a, FA.b, FA.c, FA.d]]


def test_a_level_drives_sa_alone_and_changes_drive_fa():
    rising, level = np.linspace(0, 1, 60), np.ones(60)
    values = np.stack([rising, level, rising[::-1]], axis=1)
    spikes = encoded(UNIT, values).reshape(60, 3, 3).sum(axis=0)  # (kind, channel)
    assert (spikes > 0).tolist() == [[True, True, True], [True, False, False], [False, False, True]]


def test_no_spike_without_signal_or_gain():
    assert not encoded(UNIT, np.zeros((200, 3))).any()
    assert not encoded(dataclasses.replace(UNIT, gain=0.0), wave()).any()
    constant = learnt(Receptors(), one(np.full((50, 3), 7.0)), np.array([0]))
    assert constant.low == constant.high == (7.0, 7.0, 7.0)
    assert not encoded(constant, np.full((50, 3), 7.0)).any(), "a channel that never moves is silent"
    assert not encoded(constant, wave()).any()


def test_a_huge_gain_saturates():
    values = np.ones((40, 3))
    spikes = encoded(dataclasses.replace(UNIT, gain=1e6, spikes_per_step=10), values, 10.0)
    per_kind = spikes.reshape(40, 10, 3, 3)
    assert per_kind[:, :, 0].all(), "one spike per solver step of 1 ms"
    assert not per_kind[:, :, 1:].any()


def test_spikes_of_a_step_are_told_apart_or_merged():
    values = np.ones((40, 1))
    base = Receptors(low=(0.0,), high=(1.0,), sa=True, gain=4.0)
    counts = [encoded(dataclasses.replace(base, spikes_per_step=k), values, 28.0) for k in (1, 2, 16)]
    assert np.array_equal(counts[0], counts[2][:, :3])
    assert np.array_equal(counts[1], counts[2][:, :6])
    assert counts[2][:, 3:].any()
    assert base.n_channels(5) == 15
    assert dataclasses.replace(base, spikes_per_step=2, sa=False).n_channels(5) == 20


def test_the_range_is_learnt_from_windows_of_training_recordings():
    values = wave(300, 2)
    other = values * 100
    signals = Signals(np.concatenate([values, other]), np.array([0, 300, 600]), 10.0, {})
    encoder = Receptors().fitted(signals, np.array([100, 0]), 150, np.zeros(2), 1, np.array([0]))
    low, high = np.percentile(values[100:250], (1, 99), axis=0)
    assert encoder.low == pytest.approx(tuple(low), rel=1e-6)
    assert encoder.high == pytest.approx(tuple(high), rel=1e-6)


def test_full_scale_divides_by_the_sensors_largest_value():
    signals = one(np.array([[100.0, 0.0], [400.0, 0.0], [200.0, 0.0]]))
    encoder = learnt(Receptors(full_scale=1000.0, gain_sa=50.0, gain_fa=0.0), signals, np.array([0]))
    assert (encoder.low, encoder.high) == ((0.0, 0.0), (1000.0, 1000.0))
    current = encoder.currents(signals.values.astype(np.float64), 10.0)
    np.testing.assert_allclose(current[:, :2], [[5, 0], [20, 0], [10, 0]])


def test_sparse_spikes_have_a_range():
    values = np.zeros((500, 2), np.float32)
    values[250, 0] = 1
    encoder = learnt(Receptors(), one(values), np.array([0]))
    assert (encoder.low, encoder.high) == ((0.0, 0.0), (1.0, 0.0))
    assert encoded(encoder, values).any()


@given(cut=st.integers(1, 80))
def test_causal_and_blind_to_level_without_sa(cut):
    values = wave().round()
    encoder = learnt(Receptors(smoothing_ms=30), one(values), np.array([0]))
    assert np.array_equal(encoded(encoder, values[:cut]), encoded(encoder, values)[:cut])
    changes = dataclasses.replace(encoder, sa=False)
    moved = tuple(x + 512 for x in changes.low), tuple(x + 512 for x in changes.high)
    there = dataclasses.replace(changes, low=moved[0], high=moved[1])
    assert np.array_equal(encoded(changes, values), encoded(there, values + 512))


def test_what_it_refuses():
    values = wave()
    with pytest.raises(
        ValueError, match="must be fitted to training recordings of 3 channels first, got a range"
    ):
        encoded(Receptors(), values)
    values[7, 1] = np.nan
    with pytest.raises(ValueError, match="recording 0 must hold finite numbers"):
        encoded(UNIT, values)
    with pytest.raises(ValueError, match="recording 0 must hold finite numbers"):
        learnt(Receptors(), one(values), np.array([0]))
