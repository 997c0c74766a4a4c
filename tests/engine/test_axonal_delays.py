"""Delays of axons: SLAYER's equations, by hand and against trains that are moved in time; training."""

import numpy as np
import pytest

from benchmarks.ours import rows_of
from dse.engine import cpu
from dse.engine.events import dense
from dse.engine.forward import prepare
from dse.engine.layers import weights
from dse.engine.member import Member, TrainedLayer, Turn
from dse.engine.network import gradients, layer_spikes
from dse.engine.neurons import cuba_lif
from dse.engine.neurons.fixed_point import quantise
from dse.engine.neurons.surrogate import exponential

N_IN, N_HIDDEN, N_OUT = 12, 20, 4
SURROGATE = exponential(80 / 64, 0.03, 3.0)


def population(n):
    rng = np.random.default_rng(n)
    return cuba_lif.Population(rng.integers(400, 3000, n), rng.integers(200, 2000, n), 80)


def moved(spikes, delay):
    """Return spikes (sample, step, neuron) as many steps later as each neuron's delay says."""
    out = np.zeros_like(spikes)
    for i, d in enumerate(delay.tolist()):
        out[:, d:, i] = spikes[:, : spikes.shape[1] - d, i]
    return out


def slayer_gradient(arriving, by_arriving):
    """Return dL/dd: minus the temporal derivative of what arrives, [x[t] - x[t-1]], times dL/dx[t]."""
    before = np.zeros_like(arriving)
    before[:, 1:] = arriving[:, :-1]
    return -(by_arriving * (arriving - before)).sum(axis=(0, 1))


def test_the_derivative_of_a_spike_by_hand():
    """One spike arrives at step 2: dL/dd is dL/dx[3] - dL/dx[2], as lava-dl calculates it."""
    arriving, by_arriving = np.zeros((1, 4, 1)), np.array([[[1.0], [10.0], [100.0], [1000.0]]])
    arriving[0, 2, 0] = 1
    assert slayer_gradient(arriving, by_arriving) == 900
    arriving[0, :, 0] = [0, 0, 0, 1]  # what would come after the window counts as 0
    assert slayer_gradient(arriving, by_arriving) == -1000


def test_the_derivative_is_that_of_lava_dl():
    """Golden: `slayer.axon.Delay` of lava-dl d825ac5 on these trains (delays 0.9 and 2.5 run as 0 and 2)."""
    arriving = np.zeros((2, 12, 3))
    for sample, neuron, steps in (
        (0, 0, [2, 3]),
        (0, 1, [2, 3, 4, 8, 9]),
        (1, 0, [0, 5, 7, 8, 9]),
        (1, 1, [2, 9, 11]),
    ):
        arriving[sample, steps, neuron] = 1
    by_arriving = np.arange(72.0).reshape(2, 3, 12).transpose(0, 2, 1) ** 1.5
    np.testing.assert_allclose(slayer_gradient(arriving, by_arriving), [53.9141, -399.6978, 0], rtol=1e-6)


def test_spikes_and_gradients_are_those_of_trains_that_are_moved():
    rng = np.random.default_rng(2)
    x = (rng.random((5, 90, N_IN)) < 0.2).astype(np.uint8)
    delay = rng.integers(0, 40, N_HIDDEN)
    first, last = (quantise(rng.normal(0.15, 0.6, s)) for s in ((N_IN, N_HIDDEN), (N_HIDDEN, N_OUT)))
    hidden = weights(first, None, population(N_HIDDEN))
    outputs = weights(last, None, population(N_OUT), np.broadcast_to(delay[:, None], last.shape))
    outputs = type(outputs)(outputs.feed_forward, outputs.recurrent, outputs.population, outputs.delay, True)
    fired = layer_spikes(rows_of(x), [prepare(w, "integer") for w in (hidden, outputs)])
    arriving = moved(cuba_lif.shift(dense(fired[0])), delay)
    z = arriving.astype(np.float64) @ last
    _, voltage, spikes = cuba_lif.run(z, outputs.population, "integer")
    np.testing.assert_array_equal(dense(fired[1]), spikes)

    labels = np.array([0, 3, 1, 1, 2])
    found = gradients(
        rows_of(x),
        [hidden, outputs],
        [SURROGATE] * 2,
        labels,
        true_rate=0.6,
        false_rate=0.05,
        gains=[None] * 2,
    )
    rate = cuba_lif.shift(spikes).sum(axis=1) / 90
    target = np.where(np.eye(N_OUT)[labels] > 0, 0.6, 0.05)
    by_spikes = np.broadcast_to(2 / 90 * (rate - target)[:, None], spikes.shape).copy()
    by_spikes[:, -1] = 0  # the last step's spikes are lost
    by_z = cuba_lif.backward(by_spikes, SURROGATE(voltage - 80 / 64), outputs.population)
    expected = slayer_gradient(arriving.astype(np.float64), by_z @ last.T)
    np.testing.assert_allclose(found.delay[1].sum(axis=1), expected, atol=1e-5 * np.abs(expected).max())
    by_weight = np.einsum("nti,ntj->ij", arriving.astype(np.float64), by_z)
    np.testing.assert_allclose(found.feed_forward[1], by_weight, atol=1e-5 * np.abs(by_weight).max())


def member(seed, longest=30):
    rng = np.random.default_rng(seed)
    late = np.broadcast_to(rng.uniform(0, 1, (N_HIDDEN, 1)), (N_HIDDEN, N_OUT)).astype(np.float32)
    layers = tuple(
        TrainedLayer(
            rng.normal(0.15, 0.5, shape).astype(np.float32),
            None,
            population(shape[1]),
            SURROGATE,
            np.ones(shape[1], np.float32),
            delay=late if depth else None,
            longest_delay=longest,
            axonal=bool(depth),
        )
        for depth, shape in enumerate(((N_IN, N_HIDDEN), (N_HIDDEN, N_OUT)))
    )
    return Member(layers, 0.6, 0.05)


def test_an_axon_has_one_delay_that_runs_rounded_down():
    rng = np.random.default_rng(9)
    x, labels = (rng.random((30, 50, N_IN)) < 0.2).astype(np.uint8), rng.integers(0, N_OUT, 30)
    engine = cpu.start([member(1, longest=3)], 30, 50)
    start = engine.masters(0).delay[1]
    assert start is not None and not start.any()  # below 1
    seen = [start]
    for _ in range(12):
        engine.step(rows_of(x), labels, {0: Turn(0.02, (None, None), 0.5)})
        late, masters = engine.masters(0).delay[1], engine.state(0)["1/delay/weights"]
        assert late is not None and (late == late[:, :1]).all() and 0 <= late.min() and late.max() <= 3
        np.testing.assert_array_equal(late[:, 0], np.floor(masters[:N_HIDDEN]))
        seen.append(late)
    assert seen[-1].max() == 3 and (seen[-1] == 0).any()


def test_a_training_goes_on_with_the_same_bits():
    rng = np.random.default_rng(9)
    x, labels = (rng.random((30, 50, N_IN)) < 0.2).astype(np.uint8), rng.integers(0, N_OUT, 30)
    turn = {0: Turn(0.02, (None, None), 0.5)}
    whole, again = (cpu.start([member(1)], 30, 50) for _ in range(2))
    for _ in range(3):
        whole.step(rows_of(x), labels, turn)
    again.restore(0, whole.state(0))
    for engine in (whole, again):
        for _ in range(3):
            engine.step(rows_of(x), labels, turn)
    for name, values in whole.state(0).items():
        np.testing.assert_array_equal(values, again.state(0)[name], err_msg=name)


@pytest.mark.parametrize("threads", [2])
def test_threads_change_nothing(threads):
    rng = np.random.default_rng(9)
    x, labels = (rng.random((90, 50, N_IN)) < 0.2).astype(np.uint8), rng.integers(0, N_OUT, 90)
    one, several = cpu.start([member(1)], 90, 50), cpu.start([member(1)], 90, 50, threads)
    for engine in (one, several):
        for _ in range(3):
            engine.step(rows_of(x), labels, {0: Turn(0.02, (None, None), 0.5)})
    np.testing.assert_array_equal(one.masters(0).delay[1], several.masters(0).delay[1])
