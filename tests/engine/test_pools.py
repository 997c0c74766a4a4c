"""First layers that read counts of pools: in both engines, rounded or not, as the matrix of every input."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.ours import rows_of
from dse.base.records import Spikes
from dse.engine import cpu
from dse.engine.events import gather, pooled
from dse.engine.member import Member, TrainedLayer, Turn
from dse.engine.neurons import cuba_lif
from dse.engine.neurons.surrogate import exponential

POOL = np.array([0, 2, 1, 0, 0, 2, 2, 1, 0, 0, 1, 2])


def layer(rng, rows, n, **keys):
    population = cuba_lif.Population(np.full(n, 1000), np.full(n, 300), 80)
    surrogate, unit = exponential(80 / 64, 0.03, 3.0), np.full(n, 0.5, np.float32)
    weights = rng.normal(0.1, 0.4, (rows, n)).astype(np.float32)
    return TrainedLayer(weights, None, population, surrogate, unit, **keys)


def member(arithmetic, **keys):
    rng = np.random.default_rng(3)
    return Member((layer(rng, 3, 20, **keys), layer(rng, 20, 4)), 0.6, 0.05, arithmetic, pool=POOL)


def batch():
    rng = np.random.default_rng(1)
    x = (rng.random((7, 40, 12)) < 0.2).astype(np.uint8)
    return rows_of(x), rng.integers(0, 4, 7), Turn(0.02, (None, None))


@pytest.mark.parametrize(
    ("arithmetic", "keys"), [("ideal", {}), ("integer", {}), ("integer", {"is_rounded": False})]
)
def test_both_engines_take_the_same_steps(arithmetic, keys):
    pytest.importorskip("torch")
    from dse.engine import autograd

    rows, labels, turn = batch()
    of = member(arithmetic, **keys)
    kernels, definition = cpu.start([of], 7, 40), autograd.start([of])
    for _ in range(3):
        one, other = (x.step(rows, labels, {0: turn})[0] for x in (kernels, definition))
        assert one.gradient_norm == pytest.approx(other.gradient_norm, rel=1e-5)
        assert one.fired == other.fired
    for a, b in zip(kernels.masters(0).feed_forward, definition.masters(0).feed_forward, strict=True):
        assert a.shape == b.shape
        np.testing.assert_allclose(a, b, atol=1e-5)


def test_weights_that_are_not_rounded_run_as_they_are():
    rows, labels, turn = batch()
    rounded, real = member("integer"), member("integer", is_rounded=False)
    on_grid = replace(real.layers[0], feed_forward=np.rint(32 * real.layers[0].feed_forward) / np.float32(32))
    found = [
        cpu.start([x], 7, 40).step(rows, labels, {0: turn})[0].loss
        for x in (rounded, real, replace(real, layers=(on_grid, real.layers[1])))
    ]
    assert found[0] == found[2] != found[1]


def test_threads_change_no_bit():
    rng = np.random.default_rng(5)
    rows = rows_of((rng.random((24, 900, 12)) < 0.1).astype(np.uint8))
    labels, turn = rng.integers(0, 4, 24), Turn(0.02, (None, None))
    engines = [cpu.start([member("float32")], 24, 900, n) for n in (1, 3)]
    for engine in engines:
        for _ in range(2):
            engine.step(rows, labels, {0: turn})
    for a, b in zip(*(x.masters(0).feed_forward for x in engines), strict=True):
        np.testing.assert_array_equal(a, b)


def test_pooled_rows_count_every_spike():
    rows = rows_of((np.random.default_rng(0).random((3, 20, 6)) < 0.4).astype(np.uint8))
    pool = np.array([0, 1, 0, 2, 1, 0])
    by_input = rows.per_input()
    expected = np.stack([by_input[:, pool == k].sum(axis=1) for k in range(3)], axis=1)
    np.testing.assert_array_equal(pooled(rows, pool).per_input(), expected)


def test_copies_of_pools_are_pools_of_copies():
    rng = np.random.default_rng(4)
    counts = rng.poisson(1.5, 5 * 30)
    index = np.concatenate([np.sort(rng.choice(6, min(n, 6), replace=False)) for n in counts])
    offsets = np.concatenate([[0], np.cumsum(np.minimum(counts, 6))])
    spikes = Spikes(offsets, index.astype(np.int32), 30, 6, 1.0)
    pool, delays = np.array([0, 1, 0, 2, 1, 0]), (0, 2, 7)
    window = (spikes, np.array([3, 0, 3]), np.array([4, 0, 10]), 20, delays, 2)
    expected = pooled(gather(*window), np.concatenate([pool + 3 * k for k in range(3)]))
    found = gather(*window, pool)
    assert found.n_inputs == expected.n_inputs == 9
    for name in ("offsets", "index", "times"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
