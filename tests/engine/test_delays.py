"""Delays per synapse: by hand, against the definition, automatic differentiation and finite differences."""

import numpy as np
import pytest

from benchmarks.ours import rows_of
from dse.engine import cpu, delays, engines
from dse.engine.arrivals import stride_of
from dse.engine.definition import DefinedLayer, delayed_sum
from dse.engine.events import dense
from dse.engine.layers import prepare, weights
from dse.engine.layout import packed, padded, unpacked
from dse.engine.member import Member, TrainedLayer, Turn
from dse.engine.network import gradients
from dse.engine.neurons import LayerSpec, cuba_lif
from dse.engine.neurons.fixed_point import quantise
from dse.engine.neurons.resonator import Population as Resonators
from dse.engine.neurons.resonator import Resonator
from dse.engine.neurons.surrogate import exponential

N_IN, N_HIDDEN, N_OUT = 12, 20, 4
AT_ONCE = cuba_lif.Population(np.int32(4096), np.int32(4096), 2**20)
"""Neurons whose potential is the weighted input of the step, and which never fire."""


def population(n):
    rng = np.random.default_rng(n)
    return cuba_lif.Population(rng.integers(400, 3000, n), rng.integers(200, 2000, n), 80)


def layer(rng, shape, most=62, ring=False):
    n = shape[1]
    return weights(
        quantise(rng.normal(0.15, 0.6, shape)),
        quantise(rng.normal(0, 0.3, (n, n))) if ring else None,
        population(n),
        rng.integers(0, most + 1, shape),
    )


def arrived(spikes, weight, delay, n_steps, arithmetic):
    """Return the weighted input (step, neuron) that spikes (step, input) make, as the kernel has it."""
    x = np.zeros((1, n_steps, len(weight)), np.uint8)
    for step, source in spikes:
        x[0, step, source] = 1
    of = weights(weight, None, AT_ONCE, delay)
    by_kernel = prepare(of, arithmetic).forward(rows_of(x), keep_voltage=True).voltage
    by_definition = DefinedLayer(of, arithmetic).forward(rows_of(x), keep_voltage=True).voltage
    np.testing.assert_array_equal(by_kernel, by_definition.astype(by_kernel.dtype))
    return by_kernel[0]


@pytest.mark.parametrize("arithmetic", ["integer", "float32", "ideal"])
def test_by_hand(arithmetic):
    weight = np.array([[1.0, -0.5], [2.0, 0.25]], np.float32)
    delay = np.array([[0, 62], [7, 3]])
    z = arrived([(5, 0), (10, 1), (67, 0)], weight, delay, 130, arithmetic)
    expected = np.zeros((130, 2))
    expected[5, 0] = expected[67, 0] = 1.0
    expected[67, 1] = expected[129, 1] = -0.5  # 62 steps later, over the border of a word
    expected[17, 0], expected[13, 1] = 2.0, 0.25
    np.testing.assert_array_equal(z, expected)


@pytest.mark.parametrize("n_steps", [1, 63, 64, 65, 128])
def test_spikes_beyond_the_window_are_lost(n_steps):
    for delay in (0, 1, 62):
        z = arrived([(n_steps - 1, 0)], np.ones((1, 1), np.float32), np.array([[delay]]), n_steps, "integer")
        assert z.sum() == (delay == 0)
        z = arrived([(0, 0)], np.ones((1, 1), np.float32), np.array([[delay]]), n_steps, "integer")
        assert z[delay:, 0].tolist() == ([1.0] + [0.0] * (n_steps - delay - 1) if delay < n_steps else [])


def test_two_spikes_arrive_in_one_step():
    z = arrived([(3, 0), (1, 1)], np.full((2, 1), 0.5, np.float32), np.array([[2], [4]]), 8, "integer")
    assert z[:, 0].tolist() == [0, 0, 0, 0, 0, 1.0, 0, 0]


def test_full_scale_weights_sum_exactly():
    """700 weights of -4 at once: more than an int16 of 1/32 holds."""
    delay = np.arange(700)[:, None] % 63
    spikes = [(62 - i % 63, i) for i in range(700)]
    z = arrived(spikes, np.full((700, 1), -4.0, np.float32), delay, 64, "integer")
    assert z[:, 0].tolist() == [0.0] * 62 + [-2800.0, 0.0]


def test_delays_of_0_answer_bit_for_bit_as_none():
    rng = np.random.default_rng(3)
    x = rows_of((rng.random((3, 100, N_IN)) < 0.2).astype(np.uint8))
    of = layer(rng, (N_IN, N_HIDDEN), most=0, ring=True)
    without = weights(of.feed_forward, of.recurrent, of.population)
    late, plain = (prepare(w, "integer").forward(x, keep_voltage=True, count=True) for w in (of, without))
    np.testing.assert_array_equal(late.voltage, plain.voltage)
    np.testing.assert_array_equal(late.updates, plain.updates)
    assert late.peak == plain.peak and plain.fired.index.size > 100


@pytest.mark.parametrize("arithmetic", ["integer", "ideal"])
@pytest.mark.parametrize("resonate", [False, True])
def test_the_kernel_answers_as_the_definition(arithmetic, resonate):
    rng = np.random.default_rng(5)
    x = (rng.random((3, 150, N_IN)) < 0.1).astype(np.uint8)
    of = layer(rng, (N_IN, N_HIDDEN), ring=not resonate)
    if resonate:
        drawn = Resonator().population(LayerSpec(N_HIDDEN, False, 1, 1.0), rng)
        assert isinstance(drawn, Resonators)
        of = weights(of.feed_forward, None, drawn, of.delay)
    by_kernel = prepare(of, arithmetic).forward(rows_of(x), keep_voltage=True, count=True)
    by_definition = DefinedLayer(of, arithmetic).forward(rows_of(x), keep_voltage=True, count=True)
    assert by_kernel.fired.index.size > 100
    np.testing.assert_array_equal(dense(by_definition.fired), dense(by_kernel.fired))
    if arithmetic == "integer":
        np.testing.assert_array_equal(by_definition.voltage.astype(np.float32), by_kernel.voltage)
        np.testing.assert_array_equal(by_definition.updates, by_kernel.updates)
    else:
        np.testing.assert_allclose(by_definition.voltage, by_kernel.voltage, atol=1e-9)


def by_torch(x, layers, labels, gains, penalty):
    """Return loss, dL/dw and dL/dd by automatic differentiation, from dense spikes moved in time."""
    import torch

    from dse.engine.autograd import TorchCalculus, later, layer_spikes, loss_of, on_torch
    from dse.engine.goal import SPIKE_RATE, Goal

    calculus = TorchCalculus("integer", exponential(80 / 64, 0.03, 3.0))
    y = torch.as_tensor(x.transpose(1, 0, 2), dtype=torch.float64)
    n_steps, parameters, hidden = x.shape[1], [], torch.zeros((), dtype=torch.float64)
    for depth, (of, gain) in enumerate(zip(layers, gains, strict=True)):
        w = torch.as_tensor(of.feed_forward, dtype=torch.float64).requires_grad_()
        moved = torch.zeros_like(w).requires_grad_()  # by no step, straight through
        parameters.append((w, moved))
        if gain is not None:
            y = y * torch.as_tensor(gain, dtype=torch.float64)
        drive = torch.zeros((*y.shape[:2], w.shape[1]), dtype=torch.float64)
        for d in range(int(of.delay.max(initial=0)) + 1):
            here = w * torch.as_tensor(of.delay == d) if of.delay.size else w

            def shifted(by, y=y):
                head = torch.zeros((min(max(by, 0), n_steps), *y.shape[1:]), dtype=y.dtype)
                tail = torch.zeros((max(-by, 0), *y.shape[1:]), dtype=y.dtype)
                return torch.cat([head, y[max(-by, 0) : n_steps - max(by, 0)], tail])[:n_steps]

            drive = drive + shifted(d) @ here
            before = shifted(d - 1)
            before[-1] = 0  # the step after it lies beyond the window
            drive = drive + ((shifted(d + 1) - before) / 2).detach() @ (here.detach() * moved)
        spikes = layer_spikes(drive, on_torch(of.population, calculus), calculus)
        if depth < len(layers) - 1:
            hidden = hidden + spikes.sum()
        y = later(spikes)
    loss = loss_of(y, labels, Goal(SPIKE_RATE, 0.6, 0.05, (), penalty)) + penalty * hidden
    loss.backward()
    numbers = [[p.grad.numpy() for p in pair] for pair in parameters]
    return float(loss.detach()), [w for w, _ in numbers], [d for _, d in numbers]


@pytest.mark.parametrize("deeper", [False, True])
@pytest.mark.parametrize("n_steps", [40, 70])
def test_gradients_agree_with_automatic_differentiation(deeper, n_steps):
    rng = np.random.default_rng(7)
    x = (rng.random((4, n_steps, N_IN)) < 0.2).astype(np.uint8)
    layers = [
        layer(rng, (N_IN, N_HIDDEN), 20),
        layer(rng, (N_HIDDEN, N_HIDDEN), 9),
        layer(rng, (N_HIDDEN, N_OUT), 9),
    ]
    if not deeper:
        layers[1:] = [weights(w.feed_forward, None, w.population) for w in layers[1:]]
    gains = [
        np.full((4, 1), 1.25, np.float32),
        *(2 * (rng.random((4, N_HIDDEN)) < 0.5).astype(np.float32) for _ in range(2)),
    ]
    labels = np.array([0, 3, 1, 1])
    loss, by_weight, by_delay = by_torch(x, layers, labels, gains, 0.01)
    ours = gradients(
        rows_of(x),
        layers,
        [exponential(80 / 64, 0.03, 3.0)] * 3,
        labels,
        true_rate=0.6,
        false_rate=0.05,
        gains=gains,
        hidden_spike_penalty=0.01,
    )
    assert ours.loss == pytest.approx(loss, rel=1e-6)
    for mine, theirs in zip(ours.feed_forward, by_weight, strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-5 * np.abs(theirs).max())
    for mine, theirs, of in zip(ours.delay, by_delay, layers, strict=True):
        if of.delay.size:
            assert np.abs(theirs).max() > 0
            np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-5 * np.abs(theirs).max())
        else:
            assert mine.size == 0


@pytest.mark.parametrize("axonal", [False, True])
def test_gradients_by_delays_are_finite_differences_of_a_smooth_loss(axonal):
    """L = sum of G z is linear in z, so that whole steps of a delay give the gradient exactly."""
    rng = np.random.default_rng(1)
    n, n_steps, n_in, n_out = 3, 100, 5, 18
    x = np.zeros((n, n_steps, n_in), np.uint8)
    x[:, 5:40] = rng.random((n, 35, n_in)) < 0.3
    rows = rows_of(x)
    weight = rng.normal(0, 1, (n_in, n_out))
    delay = rng.integers(1, 50, (n_in, n_out))
    smooth = np.cumsum(rng.normal(0, 1, (n, n_steps, n_out)), axis=1)

    def loss(delay):
        return float((smooth * delayed_sum(rows, slice(0, n), weight, delay)).sum())

    blocks = packed(smooth.reshape(-1, n_out), np.float64)
    by_neuron = np.zeros((padded(n_out), n, stride_of(n_steps)))
    delays.turn(blocks, n, n_steps, by_neuron)
    trains = delays.trains_of(rows.offsets, rows.index, 0, n, n_steps, n_in)
    table, late = packed(weight, np.float64), packed(delay, np.int8)
    by_weight, by_delay = np.zeros_like(table), np.zeros_like(table)
    inputs = np.arange(n_in)
    of_layer = (by_neuron, n_steps, table, late, n_out, 1.0, axonal)
    delays.add_gradients(inputs, trains, *of_layer, by_weight, by_delay)
    for i, j in [(0, 0), (2, 15), (4, 16), (3, 17)]:
        step = np.zeros_like(delay)
        step[i, j] = 1
        found = unpacked(by_delay, n_in, n_out)[i, j]
        if axonal:
            assert found == pytest.approx(loss(delay + step) - loss(delay))
        else:
            assert found == pytest.approx((loss(delay + step) - loss(delay - step)) / 2)


def member(seed, arithmetic="integer", *, deeper=False):
    rng = np.random.default_rng(seed)
    layers = tuple(
        TrainedLayer(
            rng.normal(0.15, 0.5, shape).astype(np.float32),
            None,
            population(shape[1]),
            exponential(80 / 64, 0.03, 3.0),
            np.ones(shape[1], np.float32),
            delay=rng.uniform(0, 30, shape).astype(np.float32) if seed and (deeper or not depth) else None,
            longest_delay=30,
        )
        for depth, shape in enumerate(((N_IN, N_HIDDEN), (N_HIDDEN, N_OUT)))
    )
    return Member(layers, 0.6, 0.05, arithmetic)


def test_members_train_the_same_alone_in_any_cohort_and_with_threads():
    rng = np.random.default_rng(9)
    x, labels = (rng.random((90, 50, N_IN)) < 0.2).astype(np.uint8), rng.integers(0, N_OUT, 90)
    members = [member(0), member(1), member(2, "float32", deeper=True)]
    turn = Turn(0.02, (None, None), 2.0)
    together = cpu.start(members, 90, 50, threads=2)
    for _ in range(3):
        together.step(rows_of(x), labels, dict.fromkeys(range(3), turn))
    for number, of in enumerate(members):
        alone = cpu.start([of], 90, 50)
        for _ in range(3):
            alone.step(rows_of(x), labels, {0: turn})
        a, b = alone.masters(0), together.masters(number)
        for mine, theirs, start in zip(a.delay, b.delay, of.layers, strict=True):
            assert (mine is None) == (theirs is None) == (start.delay is None)
            if mine is not None and theirs is not None and start.delay is not None:
                np.testing.assert_array_equal(mine, theirs)
                assert mine.min() >= 0 and mine.max() <= 30 and (mine != np.rint(start.delay)).any()
        for mine, theirs in zip(a.feed_forward, b.feed_forward, strict=True):
            np.testing.assert_array_equal(mine, theirs)


def test_delays_rest_without_a_learning_rate():
    rng = np.random.default_rng(9)
    x, of = (rng.random((6, 50, N_IN)) < 0.2).astype(np.uint8), member(1)
    engine = cpu.start([of], 6, 50)
    engine.step(rows_of(x), np.zeros(6, np.int64), {0: Turn(0.02, (None, None))})
    assert of.layers[0].delay is not None
    np.testing.assert_array_equal(engine.masters(0).delay[0], np.rint(of.layers[0].delay))


def test_other_devices_refuse_them():
    with pytest.raises(ValueError, match=r"delays of synapses need device cpu .* got device cuda"):
        engines.start([member(1)], 6, 50, "cuda")
