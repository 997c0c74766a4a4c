"""Decays that are learnt: gradients against automatic differentiation and finite differences; training."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.ours import rows_of
from dse.engine import cpu, engines
from dse.engine.layers import weights
from dse.engine.member import Member, TrainedLayer, Turn
from dse.engine.network import gradients
from dse.engine.neurons import cuba_lif
from dse.engine.neurons.calculus import NumpyCalculus
from dse.engine.neurons.fixed_point import quantise
from dse.engine.neurons.surrogate import exponential

N_IN, N_HIDDEN, N_OUT = 12, 20, 4
SURROGATE = exponential(80 / 64, 0.03, 3.0)
LABELS = np.array([0, 3, 1, 1])


def population(n):
    rng = np.random.default_rng(n)
    decays = rng.integers(400, 3000, n), rng.integers(200, 2000, n)
    return cuba_lif.Population(*(d.astype(np.int32) for d in decays), 80)


def stack(rng, recurrent, delayed):
    layers = []
    for n_in, n in ((N_IN, N_HIDDEN), (N_HIDDEN, N_OUT)):
        hidden = n == N_HIDDEN
        ring = quantise(rng.normal(0, 0.3, (n, n))) if recurrent and hidden else None
        late = rng.integers(0, 9, (n_in, n)) if delayed and not hidden else None
        layers.append(weights(quantise(rng.normal(0.15, 0.6, (n_in, n))), ring, population(n), late))
    return layers


def by_torch(x, layers, arithmetic):
    """Return dL/d(1 - decay) of each layer, (2, neuron), by differentiation of the neurons' definition."""
    import torch

    from dse.engine.autograd import TorchCalculus, later, layer_spikes, loss_of, on_torch
    from dse.engine.goal import SPIKE_RATE, Goal

    calculus = TorchCalculus(arithmetic, SURROGATE)
    y = torch.as_tensor(x.transpose(1, 0, 2), dtype=calculus.dtype)
    parameters = []
    for of in layers:
        learnt = on_torch(of.population, calculus)
        pair = [
            torch.as_tensor(np.asarray(d), dtype=calculus.dtype).requires_grad_()
            for d in (of.population.decay_current, of.population.decay_voltage)
        ]
        parameters.append(pair)
        w, ring = (torch.as_tensor(m, dtype=calculus.dtype) for m in (of.feed_forward, of.recurrent))
        drive = y @ w
        if of.delay.size:
            drive = torch.zeros_like(drive)
            for d in range(int(of.delay.max()) + 1):
                head = torch.zeros((d, *y.shape[1:]), dtype=y.dtype)
                drive = drive + torch.cat([head, y])[: len(y)] @ (w * torch.as_tensor(of.delay == d))
        learnt = replace(learnt, decay_current=pair[0], decay_voltage=pair[1])
        y = later(layer_spikes(drive, learnt, calculus, ring if ring.numel() else None))
    loss = loss_of(y, LABELS, Goal(SPIKE_RATE, 0.6, 0.05, (), 0.0))
    loss.backward()
    return [np.stack([-4096 * p.grad.numpy() for p in pair]) for pair in parameters]


@pytest.mark.parametrize("arithmetic", ["integer", "ideal"])
@pytest.mark.parametrize("kind", ["plain", "recurrent", "delayed"])
def test_gradients_agree_with_automatic_differentiation(arithmetic, kind):
    rng = np.random.default_rng(7)
    x = (rng.random((4, 70, N_IN)) < 0.2).astype(np.uint8)
    layers = stack(rng, kind == "recurrent", kind == "delayed")
    found = gradients(
        rows_of(x), layers, [SURROGATE] * 2, LABELS,
        true_rate=0.6, false_rate=0.05, arithmetic=arithmetic, gains=[None] * 2, of_decays=True,
    )  # fmt: skip
    for mine, theirs in zip(found.keep, by_torch(x, layers, arithmetic), strict=True):
        for ours, other in zip(mine, theirs, strict=True):
            assert np.abs(other).max() > 0
            np.testing.assert_allclose(ours, other, rtol=0, atol=2e-5 * np.abs(other).max())


def test_gradients_are_finite_differences_of_a_smooth_loss():
    """Neurons that never fire: their potential is smooth in their decays, and L = sum of G v."""
    from dse.engine.decays import add_gradients
    from dse.engine.layout import packed

    rng = np.random.default_rng(3)
    n, n_steps, width = 3, 40, 18
    z, weight = rng.normal(0, 1, (2, n, n_steps, width))
    decays = rng.integers(300, 3000, (2, width)).astype(np.float64)

    def states(decays):
        silent = cuba_lif.Population(*decays, 2**20)
        calculus = NumpyCalculus("ideal")
        state, u, v = silent.initial_state((n, width), calculus), np.zeros_like(z), np.zeros_like(z)
        for t in range(n_steps):
            state, v[:, t], _ = silent.step(state, z[:, t], calculus)
            u[:, t] = state.u
        return u, v

    def loss(decays):
        return float((weight * states(decays)[1]).sum())

    silent = cuba_lif.Population(*decays, 2**20)
    by_z = cuba_lif.backward(weight, np.ones_like(weight), silent)
    columns = 32
    flat = [packed(a.reshape(-1, width), np.float64) for a in (by_z, *states(decays))]
    keep, gradient = np.zeros(columns), np.zeros((2, columns))
    keep[:width] = silent.keep[0]
    add_gradients(flat[0], np.concatenate(flat[1:]), n, n_steps, columns, keep, gradient)
    for k, j in [(0, 0), (0, 17), (1, 3), (1, 16)]:
        step = np.zeros_like(decays)
        step[k, j] = 0.01
        slope = (loss(decays + step) - loss(decays - step)) / 0.02
        assert gradient[k, j] == pytest.approx(-4096 * slope, rel=1e-6)


def member(seed, per, arithmetic="integer"):
    rng = np.random.default_rng(seed)
    layers = tuple(
        TrainedLayer(
            rng.normal(0.15, 0.5, shape).astype(np.float32),
            None,
            population(shape[1]),
            SURROGATE,
            np.ones(shape[1], np.float32),
            learnt_decays=per,
        )
        for shape in ((N_IN, N_HIDDEN), (N_HIDDEN, N_OUT))
    )
    return Member(layers, 0.6, 0.05, arithmetic)


def batch(n=90):
    rng = np.random.default_rng(9)
    return rows_of((rng.random((n, 50, N_IN)) < 0.2).astype(np.uint8)), rng.integers(0, N_OUT, n)


TURN = Turn(0.02, (None, None), decay_learning_rate=0.02)


def test_members_train_the_same_alone_in_any_cohort_and_with_threads():
    rows, labels = batch()
    members = [member(0, "no"), member(1, "neuron"), member(2, "layer", "float32")]
    together = cpu.start(members, 90, 50, threads=2)
    for _ in range(3):
        together.step(rows, labels, dict.fromkeys(range(3), TURN))
    for number, of in enumerate(members):
        alone = cpu.start([of], 90, 50)
        for _ in range(3):
            alone.step(rows, labels, {0: TURN})
        a, b = alone.masters(0), together.masters(number)
        for mine, theirs, start in zip(a.decays, b.decays, of.layers, strict=True):
            assert (mine is None) == (theirs is None) == (start.learnt_decays == "no")
            if mine is not None and theirs is not None:
                np.testing.assert_array_equal(mine, theirs)
                assert len(set(mine[0].tolist())) == (1 if start.learnt_decays == "layer" else mine.shape[1])
        for mine, theirs in zip(a.feed_forward, b.feed_forward, strict=True):
            np.testing.assert_array_equal(mine, theirs)


def test_a_network_with_learnt_decays_is_the_network_with_these_decays():
    """The engine's loss after some steps is that of a fresh member that begins with what was learnt."""
    rows, labels = batch()
    engine = cpu.start([member(1, "neuron")], 90, 50)
    for _ in range(3):
        engine.step(rows, labels, {0: TURN})
    learnt = engine.masters(0)
    of = member(1, "no")
    layers = []
    for layer, w, decays in zip(of.layers, learnt.feed_forward, learnt.decays, strict=True):
        assert decays is not None
        assert (decays != [layer.population.decay_current, layer.population.decay_voltage]).any()
        neurons = cuba_lif.Population(decays[0], decays[1], 80)
        layers.append(replace(layer, feed_forward=w, population=neurons))
    fresh = cpu.start([replace(of, layers=tuple(layers))], 90, 50)
    assert engine.step(rows, labels, {0: TURN})[0].loss == fresh.step(rows, labels, {0: TURN})[0].loss


def test_they_descend_stay_inside_0_and_1_and_rest_without_a_step_size():
    rows, labels = batch()
    engine = cpu.start([member(1, "neuron", "ideal")], 90, 50)
    losses = [
        engine.step(rows, labels, {0: Turn(0.0, (None, None), decay_learning_rate=0.01)})[0].loss
        for _ in range(20)
    ]
    assert losses[-1] < 0.9 * losses[0]
    before = engine.masters(0).decays[0]
    engine.step(rows, labels, {0: Turn(0.02, (None, None))})
    np.testing.assert_array_equal(engine.masters(0).decays[0], before)
    for _ in range(3):
        engine.step(rows, labels, {0: Turn(0.0, (None, None), decay_learning_rate=1.0)})
        for decays in engine.masters(0).decays:
            assert decays is not None and decays.min() >= 1 and decays.max() <= 4095


def test_a_training_goes_on_with_the_same_bits():
    rows, labels = batch()
    whole, again = (cpu.start([member(1, "neuron")], 90, 50) for _ in range(2))
    for _ in range(3):
        whole.step(rows, labels, {0: TURN})
    again.restore(0, whole.state(0))
    reports = [[engine.step(rows, labels, {0: TURN})[0] for _ in range(3)] for engine in (whole, again)]
    assert reports[0] == reports[1]
    for name, values in whole.state(0).items():
        np.testing.assert_array_equal(values, again.state(0)[name], err_msg=name)


def test_other_devices_refuse_them():
    with pytest.raises(ValueError, match=r"learnt decays need device cpu .* got device cuda"):
        engines.start([member(1, "layer")], 6, 50, "cuda")
