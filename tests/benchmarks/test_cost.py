from __future__ import annotations

import contextlib
import io
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks import cost as benchmark
from benchmarks.chip_simulation import BUFFER, HOP_NS, Layout, Run, layout, simulate
from benchmarks.cost import loads, one_scale, percent
from benchmarks.mapped_cases import Case
from dse.hardware.cost import cost, cost_of_steps
from dse.hardware.profile import load
from dse.records import Layer, Network, Workload
from tests.layers import cuba_parameters

PROFILE = load("loihi1_silicon")
BARRIER_NS = 600.0
FIRED = [[[1, 1], [0, 0]], [[0, 0], [1, 0]], [[0], [1]]]
UPDATED = [[[0, 0], [1, 1]], [[0], [1]]]


def bools(rasters: list[list[list[int]]]) -> list[np.ndarray]:
    return [np.array(raster, bool) for raster in rasters]


def tiny() -> tuple[Workload, list[np.ndarray]]:
    """2 inputs -> 2 neurons -> 1 output on two cores, 2 steps."""
    sizes = (2, 2, 1)
    spikes = np.array([[2, 0, 0], [0, 1, 1]], float)
    updates = np.array([[0, 0], [2, 1]], float)
    steps = Workload(sizes, (False, False), np.ones(2), spikes, updates, 1.0)
    return steps, [np.ones((2, 2), bool), np.ones((2, 1), bool)]


def test_three_spikes_between_two_cores_add_up() -> None:
    steps, connected = tiny()
    chip = layout(PROFILE, steps, connected)
    assert (chip.n_cores, chip.tile.tolist(), chip.core.tolist()) == (2, [0, 0, 0], [2, 2, 0, 0, 1])
    assert chip.row.tolist() == [0, 1, 2, 3, 4, 4]
    assert chip.destination.tolist() == [0, 0, 1, 1] and chip.targets.tolist() == [2, 2, 1, 1]
    found = simulate(PROFILE, chip, bools(FIRED), bools(UPDATED), None)
    assert found.counts == {
        "access": 6, "update": 3, "spike": 2, "synaptic_event": 5, "message": 3, "hop_x": 0, "hop_y": 0,
    }  # fmt: skip
    assert found.energy_pj == pytest.approx(51.2 * 6 + 21.6 * 3 + 69.3 * 2 + 35.5 * 5 + 111.0 * 3, rel=1e-12)
    # Step 1: the hidden core receives two messages of two targets. Step 2: it walks through two neurons, of
    # which one fires and sends; the output's core sends nothing and receives a message of one target.
    received, sent = 2 * (16 + 2 * 3.8), 2 * (6 + 3.7) + 30 + 5.1
    assert found.step_ns == pytest.approx([BARRIER_NS + received, BARRIER_NS + sent], rel=1e-12)


def test_a_message_waits_for_its_turn_and_its_way() -> None:
    steps, connected = tiny()
    chip = layout(PROFILE, steps, connected)
    work_ns = 16 + 2 * 3.8
    found = simulate(PROFILE, chip, bools(FIRED), bools(UPDATED), BUFFER)
    # Step 1: the first is sent after 5.1 ns and the second while the first is received. Step 2: the first
    # neuron's message is received while the second is walked through.
    first, second = 5.1 + 2 * work_ns, 6 + 3.7 + 30 + 5.1 + 16 + 3.8
    assert found.step_ns == pytest.approx([BARRIER_NS + first, BARRIER_NS + second], rel=1e-12)
    # Two tiles up: a link each, which takes a message at a time; more tiles take longer to synchronise.
    up = simulate(PROFILE, replace(chip, tile=np.array([0, 0, 2])), bools(FIRED), bools(UPDATED), BUFFER)
    assert up.step_ns[0] == pytest.approx(1000 + first + 2 * HOP_NS[1], rel=1e-12)
    # And one tile along x, which here is four tiles on.
    along = simulate(PROFILE, replace(chip, tile=np.array([0, 0, 4])), bools(FIRED), bools(UPDATED), BUFFER)
    assert along.step_ns[0] == pytest.approx(1400 + first + HOP_NS[0], rel=1e-12)
    assert (along.counts["hop_x"], along.counts["hop_y"]) == (2, 0)


def star(n: int, targets: int, tile: tuple[int, int]) -> Layout:
    """A core whose n neurons each send to another core."""
    return Layout(
        0,
        2,
        np.zeros(n, np.int64),
        np.array(tile),
        np.arange(n + 1),
        np.ones(n, np.int64),
        np.full(n, targets),
    )


def all_at_once(chip: Layout, buffer: int | None) -> Run:
    n = len(chip.core)
    return simulate(
        PROFILE, chip, [np.zeros((1, 0), bool), np.ones((1, n), bool)], [np.ones((1, n), bool)], buffer
    )


def test_a_full_input_holds_up_the_core_that_sends() -> None:
    n, per_message, work_ns = 4, 6 + 3.7 + 30 + 5.1, 16 + 100 * 3.8
    chip = star(n, 100, (0, 0))
    for buffer in (1, 2, 16):  # the receiver is the slowest, however many wait there
        ended = per_message + n * work_ns
        assert all_at_once(chip, buffer).step_ns[0] - BARRIER_NS == pytest.approx(ended, rel=1e-12)
    # Neurons after those that fire are walked through only when the last message has left: the fourth finds
    # room for one when the third is served, from where 50 neurons take longer than the last message.
    silent = 90
    core = np.zeros(n + silent, np.int64)
    row = np.concatenate([np.arange(n + 1), np.full(silent, n)])
    late = replace(chip, core=core, row=row)
    fired = np.arange(n + silent)[None] < n
    args = [np.zeros((1, 0), bool), fired], [np.ones((1, n + silent), bool)]
    alone = simulate(PROFILE, late, *args, 16).step_ns[0] - BARRIER_NS
    assert alone == pytest.approx(per_message + n * work_ns, rel=1e-12)
    held = simulate(PROFILE, late, *args, 1).step_ns[0] - BARRIER_NS
    assert held == pytest.approx(per_message + (n - 1) * work_ns + silent * 9.7, rel=1e-12)
    assert held > alone


def test_the_peers_ports_follow_the_cores() -> None:
    steps, connected = tiny()
    wide = replace(steps, sizes=(1100, 2, 1))
    connected = [np.ones((1100, 2), bool), connected[1]]
    assert layout(PROFILE, wide, connected).tile.tolist() == [0, 0, 0, 0]
    last = layout(PROFILE, replace(wide, cores=(2, 1)), connected, ports_last=True)
    assert last.tile.tolist() == [0, 0, 0, 0, 1]
    assert np.bincount(last.core).tolist() == [1, 1, 1, 550, 550]


CASES = st.builds(
    Case,
    sizes=st.tuples(st.integers(1, 40), st.integers(1, 40), st.integers(1, 9)),
    recurrent=st.tuples(st.booleans(), st.booleans()),
    n_steps=st.integers(1, 60),
    input_rate=st.floats(0.01, 0.5),
    rate=st.floats(0.01, 0.3),
    bursty=st.booleans(),
)


@settings(derandomize=True, deadline=None, max_examples=60)
@given(CASES)
def test_the_closed_form_of_steps_is_exact_without_a_network(case: Case) -> None:
    means, steps = loads(case)
    found = simulate(PROFILE, layout(PROFILE, means, case.connected), *case.activity, None)
    of_steps, of_means = cost_of_steps(PROFILE, steps), cost(PROFILE, means)
    assert of_steps.n_cores.value == 2
    uj, step_us = found.energy_pj * 1e-6, found.step_ns.mean() * 1e-3
    assert float(of_steps.dynamic_uj) == pytest.approx(uj, rel=1e-12)
    assert float(of_means.dynamic_uj) == pytest.approx(uj, rel=1e-12)
    assert float(of_steps.step_time_us.value) == pytest.approx(step_us, rel=1e-12)
    assert float(of_means.step_time_us.value) <= step_us * (1 + 1e-12)


@settings(derandomize=True, deadline=None, max_examples=30)
@given(CASES, st.integers(1, 5), st.integers(1, 5), st.sampled_from((1, 2, 16)))
def test_queues_take_time_and_no_energy(case: Case, hidden: int, out: int, buffer: int) -> None:
    means = replace(loads(case)[0], cores=(min(hidden, case.sizes[1]), min(out, case.sizes[2])))
    chip = layout(PROFILE, means, case.connected)
    plain, *queued = (simulate(PROFILE, chip, *case.activity, n) for n in (None, 10**4, buffer))
    for found in queued:
        assert found.counts == plain.counts and found.energy_pj == plain.energy_pj
        assert (found.step_ns >= plain.step_ns * (1 - 1e-12)).all()
    # All that is received and sent, one after the other, is the most that it can take.
    work = 16 * plain.counts["message"] + 3.8 * plain.counts["synaptic_event"]
    hops = HOP_NS[0] * plain.counts["hop_x"] + HOP_NS[1] * plain.counts["hop_y"]
    assert queued[1].step_ns.sum() <= plain.step_ns.sum() + work + hops + 1e-6


def test_activity_is_that_of_leaky_neurons() -> None:
    case = Case((1, 1), (True,), 4, 1.0, 0.5)
    weight, back = case.weights[0][:, 0]
    fired, updated = case.activity
    v, expected, before = 0.0, [], 0
    for t in range(4):
        awake = v != 0 or t > 0
        v = np.trunc(29 / 32 * v * 64) / 64 + (weight + back * before if t else 0.0)
        before = int(v > 1)
        v -= before
        expected.append((before, awake))
    assert [(int(a[0]), bool(b[0])) for a, b in zip(fired[1], updated[0], strict=True)] == expected
    assert fired[0].all() and any(a for a, _ in expected)


def test_pruned_weights_reach_fewer_and_bursts_have_silence() -> None:
    case = Case((60, 30, 5), (True, False), 100, 0.05, 0.1, weights_left=0.25, bursty=True)
    means, _ = loads(case)
    assert means.stored == tuple(int(x.sum()) for x in case.connected)
    assert all(((w != 0) <= c).all() for w, c in zip(case.weights, case.connected, strict=True))
    assert [len(x) for x in case.targets] == [60, 30, 5] and not case.targets[2].any()
    reached = sum(int((x.sum(axis=0) * n).sum()) for x, n in zip(case.activity[0], case.targets, strict=True))
    assert means.synapses is not None
    assert reached == pytest.approx(float(np.dot(means.spikes, means.synapses)))
    assert case.inputs[:10].any() and not case.inputs[10:50].any() and case.inputs[50:60].any()


def test_one_scale_uses_its_full_range_for_the_largest_weight() -> None:
    layer = Layer(np.array([[0.5, -3.0]], np.float32), None, cuba_parameters(np.zeros(1), np.zeros(1), 80))
    second = replace(layer, weight=np.array([[0.75]], np.float32), recurrent=np.array([[1.6]], np.float32))
    network = Network((layer, second), 2, (0,), 1, "integer")
    found = one_scale(network, 2)
    assert [x.weight.tolist() for x in found.layers] == [[[0.0, -3.0]], [[0.0]]]
    assert found.layers[1].recurrent is not None and found.layers[1].recurrent.tolist() == [[3.0]]
    assert one_scale(network, 3).layers[1].weight.tolist() == [[1.0]]


def test_errors_are_signed_percentages() -> None:
    assert [percent(*x) for x in ((1.5, 1.0), (0.99, 1.0), (1.0, 1.0), (0.0, 0.0))] == ["+50", "-1", "0", "0"]


def test_drawn_bursts_keep_the_mean_and_gather_it() -> None:
    means, most = [], []
    for burst in (1, 5):
        found = benchmark.drawn_counts((50, 20, 5), 200, 100, burst, np.random.default_rng(0))
        means.append(found.spikes.mean())
        most.append((found.spikes.sum(axis=-1) == 0).mean())
    assert means[1] == pytest.approx(means[0], rel=0.1)
    assert most[0] < 0.3 < most[1]
    assert all(a < b for a, b in pairwise(most))


def test_the_tables_are_printed_without_peer_and_recordings(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DSE_DATA", raising=False)
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        benchmark.main(["--quick", "--rounds", "1", "--python", "sanafe=nowhere"])
    text = " ".join(out.getvalue().split())
    for expected in (
        "SANA-FE is left out: nowhere does not have it", "24-50-7", "bursty", "drawn, bursts",
        "a million design points", "Left out: DSE_DATA names no recordings.",
    ):  # fmt: skip
        assert expected in text


def test_mean_counts_lose_time_and_no_energy() -> None:
    steps = benchmark.drawn_counts((24, 50, 7), 3, 50, 5, np.random.default_rng(1))
    cells = benchmark.mean_errors(PROFILE, steps, 1)
    energy, energy_each, time, time_each = cells[7:11]
    assert (energy, energy_each) == ("0", "0")
    assert float(time) < 0 and float(time_each) < 0
