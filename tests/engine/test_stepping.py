"""A stack that runs step by step fires as the same stack does in one pass."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.ours import rows_of
from dse.base.records import Spikes
from dse.engine.events import delayed, gather
from dse.engine.forward import prepare
from dse.engine.layers import weights
from dse.engine.network import layer_spikes
from dse.engine.neurons import cuba_lif, lif, resonator, xylo_lif
from dse.engine.neurons.fixed_point import quantise
from dse.engine.stepping import RunningStack

N_STEPS = 24


def stored(raster):
    rows = rows_of(raster)
    return Spikes(rows.offsets, rows.index, raster.shape[1], raster.shape[2], 1.0)


def population(rng, neuron, n):
    decays = rng.integers(0, 4097, (2, n)).astype(np.int32)
    if neuron == "lif":
        return lif.Population(0.2, 3.0, 0.0, 1.0)
    if neuron == "xylo_lif":
        shifts = rng.integers(1, 5, (2, n))
        return xylo_lif.Population(*shifts, int(rng.integers(1, 400)), 1, int(rng.integers(1, 32)))
    if neuron == "cuba_lif":
        return cuba_lif.Population(*decays, int(rng.integers(1, 400)))
    c, s = resonator.factors(rng.uniform(2.2, 20, n), rng.uniform(1, 4, n))
    return resonator.Population(
        rng.random(n) < 0.5, c, s, *decays, int(rng.integers(1, 400)), bool(rng.integers(2))
    )


@given(
    seed=st.integers(0, 2**32 - 1),
    neuron=st.sampled_from(["cuba_lif", "resonator", "lif", "xylo_lif"]),
    arithmetic=st.sampled_from(["integer", "float32", "ideal"]),
    hidden=st.lists(st.integers(1, 70), min_size=0, max_size=3),
    recurrent=st.booleans(),
    delays=st.sampled_from([(0,), (0, 3, 7), (2,), (5, 1)]),
    per_sample=st.sampled_from([1, 3]),
    rate=st.sampled_from([0.0, 0.1, 1.0]),
    scale=st.sampled_from([0.05, 1.0, 100.0]),
)
def test_steps_fire_as_one_pass_does(
    seed, neuron, arithmetic, hidden, recurrent, delays, per_sample, rate, scale
):
    if neuron == "lif" and arithmetic == "integer":
        arithmetic = "float32"
    rng = np.random.default_rng(seed)
    sizes = [9 * len(delays), *hidden, 3]
    stack = []
    for n_in, n in itertools.pairwise(sizes):
        w = (scale * rng.normal(size=(n_in, n))).astype(np.float32)
        ring = (scale * rng.normal(size=(n, n))).astype(np.float32) if recurrent else None
        if arithmetic == "integer":
            w, ring = quantise(w), None if ring is None else quantise(ring)
        w[rng.random(w.shape) < 0.3] = 0
        stack.append(prepare(weights(w, ring, population(rng, neuron, n)), arithmetic))
    spikes = stored(rng.random((1, N_STEPS + 4, 9)) < rate)
    first = 2
    rows = gather(spikes, np.array([0]), np.array([first]), N_STEPS, delays, per_sample)
    expected = [fired.per_step()[0] for fired in layer_spikes(rows, stack)]
    index = [fired.index for fired in layer_spikes(rows, stack)]
    running = RunningStack(stack, 9, delays, per_sample)
    counts, fired = [[] for _ in stack], [[] for _ in stack]
    for t in range(N_STEPS * per_sample):
        row = first + t // per_sample
        running.step(spikes.channel[spikes.row_offsets[row] : spikes.row_offsets[row + 1]])
        for k, of_layer in enumerate(running.fired):
            counts[k].append(len(of_layer))
            fired[k] += of_layer.tolist()
    for k in range(len(stack)):
        assert counts[k] == expected[k].tolist()
        assert fired[k] == index[k].tolist()


def test_the_last_spikes_come_out_a_step_later():
    population = cuba_lif.Population(np.array([4096], np.int32), np.array([4096], np.int32), 32)
    layer = prepare(weights(np.ones((1, 1), np.float32), None, population), "integer")
    running = RunningStack([layer], 1, (0,), 1)
    spike, none = np.zeros(1, np.int32), np.zeros(0, np.int32)
    seen = []
    for channels in (spike, none, spike):
        seen.append(running.output.tolist())
        running.step(channels)
    assert seen == [[], [0], []]
    rows = gather(stored(np.array([[[1], [0], [1]]])), np.array([0]), np.array([0]), 3)
    assert delayed(layer.forward(rows).fired).per_step().tolist() == [[0, 1, 0]]


@pytest.mark.parametrize(
    ("neuron", "arithmetic"),
    [("cuba_lif", "integer"), ("cuba_lif", "float32"), ("cuba_lif", "ideal"), ("lif", "float32")],
)
def test_spikes_that_arrive_later_arrive_in_steps_too(neuron, arithmetic):
    rng = np.random.default_rng(4)
    stack = []
    for n_in, n in ((9, 40), (40, 30), (30, 5)):
        w = rng.normal(0.2, 0.5, (n_in, n)).astype(np.float32)
        delay = rng.integers(0, 63, (n_in, 1) if n_in == 40 else w.shape) * np.ones(w.shape, np.int64)
        late = weights(quantise(w), None, population(rng, neuron, n), None if n_in == 30 else delay)
        stack.append(prepare(late, arithmetic))
    spikes = stored(rng.random((1, 150, 9)) < 0.3)
    rows = gather(spikes, np.array([0]), np.array([0]), 150)
    expected = [fired.listed()[:, 1:].tolist() for fired in layer_spikes(rows, stack)]
    running, fired = RunningStack(stack, 9, (0,), 1), [[] for _ in stack]
    for t in range(150):
        running.step(spikes.channel[spikes.row_offsets[t] : spikes.row_offsets[t + 1]])
        for k, of_layer in enumerate(running.fired):
            fired[k] += [[t, neuron] for neuron in of_layer.tolist()]
    assert fired == expected and all(len(x) > 10 for x in expected)
