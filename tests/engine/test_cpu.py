"""Cohorts of the CPU engine: steps against the equations, and the same numbers with any number of threads."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.ours import rows_of
from dse.engine import cpu
from dse.engine.adam import adam
from dse.engine.layers import weights
from dse.engine.losses.count_cross_entropy import CountCrossEntropy
from dse.engine.member import Masters, Member, TrainedLayer, Turn
from dse.engine.network import gradients
from dse.engine.neurons import cuba_lif, fixed_point
from dse.engine.neurons.surrogate import exponential


def drawn(rng, n_in, n_out, ring=False):
    return TrainedLayer(
        rng.normal(0.05, 0.5, (n_in, n_out)).astype(np.float32),
        rng.normal(0, 0.3, (n_out, n_out)).astype(np.float32) if ring else None,
        cuba_lif.Population(rng.integers(100, 3000, n_out), rng.integers(50, 2000, n_out), 80),
        exponential(80 / 64, 0.03, 3.0),
        rng.uniform(0.5, 2, n_out).astype(np.float32),
        np.full(n_out, 0.7, np.float32) if ring else None,
    )


def member(arithmetic="integer", ring=False, seed=0):
    rng = np.random.default_rng(seed)
    return Member((drawn(rng, 20, 70, ring), drawn(rng, 70, 30), drawn(rng, 30, 4)), 0.6, 0.05, arithmetic)


def batch(n=9, n_steps=1000):
    rng = np.random.default_rng(1)
    return (rng.random((n, n_steps, 20)) < 0.05).astype(np.uint8), rng.integers(0, 4, n)


def dropped(rng, n):
    gains = [2 * (rng.random((n, size)) < 0.5).astype(np.float32) for size in (70, 30)]
    return Turn(0.01, (None, *gains))


@pytest.mark.parametrize("ring", [False, True])
@pytest.mark.parametrize("arithmetic", ["integer", "float32", "ideal"])
def test_threads_change_no_bit(arithmetic, ring):
    x, labels = batch()  # four samples to a chunk: three chunks
    results = []
    for threads in (1, 2, 3):
        cohort = cpu.start([member(arithmetic, ring), member(seed=3)], 9, 1000, threads)
        rng = np.random.default_rng(2)
        reports = [
            cohort.step(rows_of(x), labels, {0: dropped(rng, 9), 1: dropped(rng, 9)}) for _ in range(2)
        ]
        results.append((reports, cohort.masters(0)))
    for reports, masters in results[1:]:
        assert reports == results[0][0]
        for a, b in zip(masters.feed_forward, results[0][1].feed_forward, strict=True):
            np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("arithmetic", ["integer", "ideal"])
def test_steps_are_gradients_then_adam(arithmetic):
    x, labels = batch(5, 40)
    one = replace(member(arithmetic), loss=CountCrossEntropy(0.3, 2), hidden_spike_penalty=0.02)
    cohort = cpu.start([one], 5, 40)
    masters = [layer.feed_forward for layer in one.layers]
    moments = [(np.zeros_like(w), np.zeros_like(w)) for w in masters]
    rng, same = np.random.default_rng(2), np.random.default_rng(2)
    rounding = fixed_point.quantise if arithmetic == "integer" else np.asarray
    for step in range(1, 4):
        report = cohort.step(rows_of(x), labels, {0: dropped(rng, 5)})[0]
        layers = [
            weights(rounding(w), None, layer.population) for w, layer in zip(masters, one.layers, strict=True)
        ]
        found = gradients(
            rows_of(x),
            layers,
            [layer.surrogate for layer in one.layers],
            labels,
            true_rate=0.6,
            false_rate=0.05,
            arithmetic=arithmetic,
            gains=dropped(same, 5).gains,
            loss=one.loss,
            hidden_spike_penalty=0.02,
        )
        assert (report.loss, report.correct, report.fired) == (found.loss, found.correct, found.fired)
        norm = 0.0
        for k, layer in enumerate(one.layers):
            passes = fixed_point.quantise_passes(masters[k]) if arithmetic == "integer" else 1
            g = found.feed_forward[k] * passes
            norm += float((g.astype(np.float64) ** 2).sum())
            masters[k], *moments[k] = adam(masters[k], g, *moments[k], step, 0.01 * layer.unit)
        assert report.gradient_norm == pytest.approx(np.sqrt(norm), rel=1e-5)
        for a, b in zip(cohort.masters(0).feed_forward, masters, strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-5, atol=1e-6)
        masters = list(cohort.masters(0).feed_forward)  # so that a rounding does not grow into a spike


def test_members_without_a_turn_do_not_move():
    x, labels = batch(4, 30)
    cohort = cpu.start([member(), member(seed=5)], 4, 30)
    before = cohort.masters(1)
    reports = cohort.step(rows_of(x), labels, {0: Turn(0.1, (None, None, None))})
    assert set(reports) == {0}
    for a, b in zip(before.feed_forward, cohort.masters(1).feed_forward, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("arithmetic", ["integer", "float32", "ideal"])
@pytest.mark.parametrize("ring", [False, True])
def test_pruned_weights_stay_at_0_and_the_rest_trains_as_without_them(arithmetic, ring):
    x, labels = batch(5, 40)
    one = member(arithmetic, ring)
    rng = np.random.default_rng(4)
    kept = Masters(
        tuple(rng.random(layer.feed_forward.shape) < 0.4 for layer in one.layers),
        tuple(
            None if r is None else rng.random(r.shape) < 0.4
            for r in (layer.recurrent for layer in one.layers)
        ),
    )
    late = cpu.start([one], 5, 40)
    turn = Turn(0.05, (None, None, None))
    late.step(rows_of(x), labels, {0: turn})  # so that there are moments to forget
    late.prune(0, kept)
    for _ in range(3):
        late.step(rows_of(x), labels, {0: turn})
    found = late.masters(0)
    for w, k, layer in zip(found.feed_forward, kept.feed_forward, one.layers, strict=True):
        assert (w[~k] == 0).all()
        assert (w[k] != layer.feed_forward[k]).mean() > 0.5
    if ring:
        assert (found.recurrent[0][~kept.recurrent[0]] == 0).all()

    # A network that began without these weights has the same gradients, and the same norm of them.
    without = [
        replace(
            layer, feed_forward=layer.feed_forward * k, recurrent=None if r is None else layer.recurrent * r
        )
        for layer, k, r in zip(one.layers, kept.feed_forward, kept.recurrent, strict=True)
    ]
    first, second = cpu.start([one], 5, 40), cpu.start([replace(one, layers=tuple(without))], 5, 40)
    first.prune(0, kept)
    second.prune(0, kept)
    second.prune(0, kept)  # twice is once
    reports = [cohort.step(rows_of(x), labels, {0: turn}) for cohort in (first, second)]
    assert reports[0] == reports[1]
    for a, b in zip(first.masters(0).feed_forward, second.masters(0).feed_forward, strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_member_with_heads_counts_samples_with_every_head_right():
    x, _ = batch(6, 40)
    labels = np.stack([np.arange(6) % 2, 2 + np.arange(6) % 2], axis=1)
    one = replace(member(), heads=(2, 2))
    cohort, same = cpu.start([one], 6, 40), cpu.start([one], 6, 40)
    turn = {0: Turn(0.01, (None, None, None))}
    report = cohort.step(rows_of(x), labels, turn)[0]
    found = [
        same.step(rows_of(x[i : i + 1]), labels[i : i + 1], {0: Turn(0.0, (None, None, None))})[0]
        for i in range(6)
    ]
    assert report.correct == sum(r.correct for r in found)
    assert report.loss == pytest.approx(sum(r.loss for r in found))
