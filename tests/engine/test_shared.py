"""Weights that synapses share: numbers, sums of gradients, and steps of both CPU engines."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.ours import rows_of
from dse.engine import cpu
from dse.engine.member import Member, TrainedLayer, Turn
from dse.engine.neurons import cuba_lif
from dse.engine.neurons.surrogate import exponential
from dse.engine.shared import copies_of, distinct, expanded

NUMBER = np.array([[0, -1, 2], [1, 0, -1], [2, 2, 1]], np.int32)


def test_shared_weights_stand_at_all_their_synapses():
    assert copies_of(NUMBER).n_weights == 3
    at_synapses = expanded(np.array([5.0, 6, 7]), NUMBER)
    np.testing.assert_array_equal(at_synapses, [[5, 0, 7], [6, 5, 0], [7, 7, 6]])
    np.testing.assert_array_equal(distinct(at_synapses, NUMBER), [5, 6, 7])


def test_a_matrix_without_synapses_trains_nothing():
    none = member(np.full((12, 18), -1, np.int32))
    rows, labels, turn = batch()
    engine = cpu.start([none], 7, 40)
    assert np.isfinite(engine.step(rows, labels, {0: turn})[0].gradient_norm)
    assert not engine.masters(0).feed_forward[0].any()


def layer(rng, weights, shared):
    n = weights.shape[1]
    population = cuba_lif.Population(np.full(n, 1000), np.full(n, 300), 80)
    surrogate, unit = exponential(80 / 64, 0.03, 3.0), np.full(n, 0.5, np.float32)
    return TrainedLayer(weights.astype(np.float32), None, population, surrogate, unit, shared=shared)


def member(number=None, arithmetic="ideal", **keys):
    """Return 12 inputs into 6 columns of 3 neurons, each with two inputs of its own and two of the next."""
    rng = np.random.default_rng(3)
    first = np.full((12, 6, 3), -1, np.int32)
    for column in range(6):
        for k in range(4):
            first[(2 * column + k) % 12, column] = 3 * k + np.arange(3)
    shared = first.reshape(12, 18) if number is None else number
    weights = expanded(rng.normal(0.4, 0.8, 12), shared)
    return Member(
        (layer(rng, weights, shared), layer(rng, rng.normal(0.1, 0.4, (18, 4)), None)),
        0.6,
        0.05,
        arithmetic,
        **keys,
    )


def batch():
    rng = np.random.default_rng(1)
    x = (rng.random((7, 40, 12)) < 0.2).astype(np.uint8)
    return rows_of(x), rng.integers(0, 4, 7), Turn(0.05, (None, None))


@pytest.mark.parametrize("arithmetic", ["integer", "float32", "ideal"])
def test_copies_stay_equal_bit_for_bit_and_move_as_one_weight(arithmetic):
    of = member(arithmetic=arithmetic, clip_norm=0.5)
    shared = of.layers[0].shared
    assert shared is not None
    rows, labels, turn = batch()
    engine = cpu.start([of], 7, 40)
    for _ in range(4):
        engine.step(rows, labels, {0: turn})
    after = engine.masters(0).feed_forward[0]
    np.testing.assert_array_equal(after, expanded(distinct(after, shared), shared))
    assert (distinct(after, shared) != distinct(of.layers[0].feed_forward, shared)).all()


def test_both_engines_take_the_same_steps():
    pytest.importorskip("torch")
    from dse.engine import autograd

    rows, labels, turn = batch()
    of = member()
    kernels, definition = cpu.start([of], 7, 40), autograd.start([of])
    for _ in range(3):
        one, other = (x.step(rows, labels, {0: turn})[0] for x in (kernels, definition))
        assert one.gradient_norm == pytest.approx(other.gradient_norm, rel=1e-6)
    for a, b in zip(kernels.masters(0).feed_forward, definition.masters(0).feed_forward, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-6)


def test_the_gradient_is_that_of_the_weight_behind_its_copies():
    """Automatic differentiation of a matrix that is indexed from its weights knows nothing of copies."""
    torch = pytest.importorskip("torch")
    from dse.engine.autograd import TorchCalculus, on_torch, run

    rows, labels, turn = batch()
    of = member()
    shared = of.layers[0].shared
    assert shared is not None
    calculi = [TorchCalculus("ideal", x.surrogate) for x in of.layers]
    weights, read_out = (
        torch.tensor(x, dtype=torch.float64, requires_grad=True)
        for x in (distinct(of.layers[0].feed_forward, shared), of.layers[1].feed_forward)
    )
    matrix = torch.cat([weights, torch.zeros(1, dtype=torch.float64)])[torch.as_tensor(shared).long()]
    populations = [on_torch(x.population, c) for x, c in zip(of.layers, calculi, strict=True)]
    pairs = [(matrix, None), (read_out, None)]
    run(rows, slice(0, 7), labels, pairs, populations, calculi, (None, None), of.goal).loss.backward()
    squares = [float((x.grad**2).sum()) for x in (weights, read_out)]
    engine = cpu.start([of], 7, 40)
    norm = engine.step(rows, labels, {0: turn})[0].gradient_norm
    assert norm == pytest.approx(np.sqrt(sum(squares)), rel=1e-5)
    # Adam's first step is the rate against the sign of the gradient.
    moved = distinct(engine.masters(0).feed_forward[0], shared) - distinct(of.layers[0].feed_forward, shared)
    np.testing.assert_allclose(moved, -0.05 * 0.5 * np.sign(weights.grad.numpy()), rtol=1e-3)


def test_weights_that_have_one_copy_each_train_as_any_others():
    rows, labels, turn = batch()
    alone = member(np.arange(12 * 18, dtype=np.int32).reshape(12, 18) % 12)
    number = np.arange(12 * 18, dtype=np.int32).reshape(12, 18)
    first = alone.layers[0]
    results = []
    for shared in (number, None):
        engine = cpu.start([replace(alone, layers=(replace(first, shared=shared), alone.layers[1]))], 7, 40)
        engine.step(rows, labels, {0: turn})
        results.append(engine.masters(0))
    for a, b in zip(*(x.feed_forward for x in results), strict=True):
        np.testing.assert_array_equal(a, b)
