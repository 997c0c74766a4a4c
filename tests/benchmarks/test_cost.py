import contextlib
import io
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks import cost as benchmark
from benchmarks.chip_simulation import HOP_NS, layout, simulate
from benchmarks.cost import loads
from benchmarks.mapped_cases import Case
from dse.base.records import Workload
from dse.measure.hardware.cost import cost, cost_of_steps
from dse.measure.hardware.profile import load

PROFILE = load("loihi1_silicon")
BARRIER_NS = 600.0
FIRED = [[[1, 1], [0, 0]], [[0, 0], [1, 0]], [[0], [1]]]
UPDATED = [[[0, 0], [1, 1]], [[0], [1]]]


def bools(rasters):
    return [np.array(raster, bool) for raster in rasters]


def tiny():
    """2 inputs -> 2 neurons -> 1 output on two cores, 2 steps."""
    sizes = (2, 2, 1)
    spikes = np.array([[2, 0, 0], [0, 1, 1]], float)
    updates = np.array([[0, 0], [2, 1]], float)
    steps = Workload(sizes, (False, False), np.ones(2), spikes, updates, 1.0)
    return steps, [np.ones((2, 2), bool), np.ones((2, 1), bool)]


def test_three_spikes_between_two_cores_add_up():
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


CASES = st.builds(
    Case,
    sizes=st.tuples(st.integers(1, 40), st.integers(1, 40), st.integers(1, 9)),
    recurrent=st.tuples(st.booleans(), st.booleans()),
    n_steps=st.integers(1, 60),
    input_rate=st.floats(0.01, 0.5),
    rate=st.floats(0.01, 0.3),
    bursty=st.booleans(),
)


@given(CASES)
def test_the_closed_form_of_steps_is_exact_without_a_network(case):
    means, steps = loads(case)
    found = simulate(PROFILE, layout(PROFILE, means, case.connected), *case.activity, None)
    of_steps, of_means = cost_of_steps(PROFILE, steps), cost(PROFILE, means)
    assert of_steps.n_cores.value == 2
    uj, step_us = found.energy_pj * 1e-6, found.step_ns.mean() * 1e-3
    assert float(of_steps.dynamic_uj) == pytest.approx(uj, rel=1e-12)
    assert float(of_means.dynamic_uj) == pytest.approx(uj, rel=1e-12)
    assert float(of_steps.step_time_us.value) == pytest.approx(step_us, rel=1e-12)
    assert float(of_means.step_time_us.value) <= step_us * (1 + 1e-12)


@given(CASES, st.integers(1, 5), st.integers(1, 5), st.sampled_from((1, 2, 16)))
def test_queues_take_time_and_no_energy(case, hidden, out, buffer):
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


def test_the_tables_are_printed_without_peer_and_recordings(monkeypatch):
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
