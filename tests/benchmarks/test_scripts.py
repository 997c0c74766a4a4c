"""What benchmark scripts print: audits, distances, plain loops beside the engine, answers of workers."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.audits import COLUMNS, line
from benchmarks.cases import CASES, Variant
from benchmarks.scene import pooled, van_rossum
from benchmarks.step_contender import contender
from benchmarks.train_step import EXACT, error, exact_gradients
from benchmarks.worker import NotInstalled, Worker
from dse.base.records import Block
from dse.models.snn.train import train
from dse.study.audit import probe
from tests.study.audit import planted


def test_a_line_holds_the_worst_of_moved_windows_and_unseen_groups():
    rows, _ = probe(planted.by_group(0))
    cells = line(rows)
    assert len(cells) == len(COLUMNS)
    unseen = [row.without for row in rows if row.probe.startswith("unseen")]
    assert cells[0] == "0.333" and cells[5] == f"{min(unseen):.3f}" and "unseen force" in cells[-1]


def test_a_plain_loop_trains_a_design_as_the_engine_does(tmp_path, monkeypatch):
    from benchmarks import grid  # and with it torch

    monkeypatch.delenv("DSE_DATA", raising=False)
    space, data, recorded = grid.load(tmp_path, 1, "float32")
    assert not recorded
    number = 22
    accuracy = grid.task(space, data, [number]).train("csr loop", number)
    ((_, outcome),) = train(data, [grid.designs(space)[number]], grid.shared(space))
    found = outcome.validation.output.sum(axis=1).argmax(axis=1) == data.target[data.validation]
    assert accuracy == found.mean()
    assert 1.5 / len(data.classes) < accuracy < 1


def block(t_us, x, y):
    return Block(
        np.array(t_us, np.int64), np.array(x, np.int32), np.array(y, np.int32), np.zeros(len(x), np.uint8)
    )


def test_events_are_counted_in_pools_of_4_pixels_that_lie_in_the_frame():
    found = pooled(block([0, 900, 1000, 1999, 500], [0, 3, 4, 7, 9], [0, 3, 0, 3, 0]), (10, 5), 2.0)
    np.testing.assert_array_equal(found, [[2, 0], [0, 2]])


def test_van_rossum_distance_of_shifted_spikes_is_known():
    """Of single spikes dt apart: |f - g|^2 = (1 - exp(-dt / tau)) 2 |f|^2."""
    a, b = np.zeros((2000, 1)), np.zeros((2000, 1))
    a[5], b[12] = 1, 1
    assert van_rossum(a, b, 10.0) == pytest.approx(np.sqrt(2 * (1 - np.exp(-0.7))), rel=1e-6)
    assert van_rossum(b, b, 10.0) == 0


def echo():
    return Worker(sys.executable, "tests.benchmarks.echo")


def test_a_worker_answers_on_one_thread_whatever_is_printed():
    with echo() as worker:
        assert worker.ask("echo", 1, "two", [3.5]) == [1, "two", [3.5]]
        assert worker.ask("echo") == []
        assert worker.ask("threads") == "1"


def test_a_missing_framework_or_python_is_not_installed():
    with echo() as worker, pytest.raises(NotInstalled, match="no_such_framework"):
        worker.ask("missing")
    with pytest.raises(NotInstalled, match="/nowhere/python cannot be run"):
        Worker("/nowhere/python", "tests.benchmarks.echo")


def test_a_failed_worker_says_its_last_line():
    with echo() as worker:
        for _ in range(2):
            with pytest.raises(RuntimeError, match="ValueError: no such thing"):
                worker.ask("fail")


@pytest.fixture(scope="module")
def exact():
    return exact_gradients(TINY)


TINY = CASES["tiny"]
WITNESSES = {
    Variant("ideal"): "loop",
    Variant("integer"): "dse, integer",
    Variant("ideal", 1.0): "loop, resonators",
    Variant("integer", 1.0): "dse, resonators, integer",
    Variant("integer", 0.5): "dse, half resonators, integer",
    Variant("integer", regions=12): "dse, 12 regions, integer",
}


@pytest.mark.parametrize("name", [name for name in EXACT if not name.startswith("spikingjelly")])
def test_gradients_and_answers_are_the_witness_s(name, exact):
    variant = EXACT[name]
    it = contender(name, TINY)
    assert error(it.gradients(), exact[variant]) < 1e-5
    real = replace(variant, arithmetic="ideal") if variant.arithmetic == "float32" else variant
    reference = contender(WITNESSES[real], TINY)
    np.testing.assert_array_equal(np.asarray(it.infer()), np.asarray(reference.infer()))
    rates = it.rates()
    assert len(rates) == 2 and all(0 < rate < 1 for rate in rates)


def test_rounded_weights_are_neighbours_on_the_grid_and_unbiased():
    case = CASES["C"]
    for w, rounded in zip(case.weights, case.weights_of(Variant("integer")), strict=True):
        np.testing.assert_array_equal(rounded * 32, np.round(rounded * 32))
        assert np.abs(rounded - w).max() < 1 / 32
        assert abs((rounded - w).mean()) < 4 * (1 / 64) / np.sqrt(w.size)
