"""Verdicts of runs, by hand."""

from dataclasses import replace

import numpy as np
import pytest

from dse.deploy.reference import Reference
from dse.deploy.targets import Run, compare
from dse.deploy.verdict import Verdict

NONE = np.zeros((0, 3), np.int32)


def spikes(*rows):
    return np.array(rows, np.int32).reshape(-1, 3)


HIDDEN = spikes((0, 0, 1), (0, 2, 0), (2, 1, 1))
OUTPUT = spikes((0, 1, 1), (0, 2, 1), (2, 3, 0))


@pytest.fixture
def reference():
    """Three recordings of four steps, of which the second is silent."""
    return Reference(
        inputs=None,
        first_step=np.zeros(3, np.int64),
        dataset=None,
        spikes_in=NONE,
        fired=(HIDDEN, OUTPUT),
        label=np.array([1, 0, 0]),
        time_ms=np.array([10.0, 20.0, 20.0]),
        decided=np.array([True, False, False]),
        n_steps=4,
        step_ms=5.0,
    )


@pytest.fixture
def run(reference):
    return Run(reference.label, reference.time_ms, reference.decided, reference.fired)


def test_equal_decisions_and_spikes_are_faithful(reference, run):
    shuffled = replace(run, fired=[layer[::-1].astype(np.int64) for layer in run.fired])
    for each in (run, shuffled):
        verdict = compare(reference, each, {"ram_bytes": 12}, run_by=["gcc 1.2"])
        assert verdict == Verdict(
            "faithful", n_recordings=3, figures={"ram_bytes": 12}, output_f1=1.0, run_by=("gcc 1.2",)
        )


@pytest.mark.parametrize(
    ("changes", "n_differ"),
    [
        ({"label": np.array([1, 1, 0])}, 1),
        ({"time_ms": np.array([15.0, 20.0, 15.0])}, 2),
        ({"decided": np.array([True, True, False])}, 1),
    ],
)
def test_any_decision_that_differs_is_approximate(reference, run, changes, n_differ):
    verdict = compare(reference, replace(run, **changes))
    assert (verdict.kind, verdict.spikes_differ, verdict.largest_difference) == ("approximate", 0, 0)
    assert verdict.decisions_differ == n_differ / 3
    assert verdict.reason == f"{n_differ} of 3 recordings decide and 0 spike otherwise"


@pytest.mark.parametrize(
    ("fired", "n_differ", "largest", "f1"),
    [
        ((HIDDEN[:2], OUTPUT), 1, 0, 1),  # a hidden spike is missing
        ((spikes((1, 0, 0), *HIDDEN), OUTPUT), 1, 0, 1),  # one in the silent recording
        ((spikes((0, 1, 1), *HIDDEN[1:]), OUTPUT), 1, 0, 1),  # one a step late
        ((np.concatenate([HIDDEN, HIDDEN[:1]]), OUTPUT), 1, 0, 1),  # one twice
        ((HIDDEN, NONE), 2, 2, 0),  # the output spike of the last step is counted by nobody
        ((HIDDEN, spikes((0, 0, 1), *OUTPUT[1:])), 1, 0, 1),  # one a step early
        ((HIDDEN, spikes((0, 1, 0), *OUTPUT[1:])), 1, 1, 1 / 2),  # one of another class
        ((HIDDEN, spikes(*OUTPUT, (1, 0, 3), (1, 1, 3), (1, 2, 3))), 1, 3, 4 / 7),
        ((NONE, NONE), 2, 2, 0),
    ],
)
def test_equal_decisions_with_other_spikes_are_equivalent(reference, run, fired, n_differ, largest, f1):
    verdict = compare(reference, replace(run, fired=fired))
    assert (verdict.kind, verdict.decisions_differ) == ("equivalent", 0)
    assert verdict.spikes_differ == n_differ / 3
    assert (verdict.largest_difference, verdict.output_f1) == (largest, f1)
    assert f"0 of 3 recordings decide and {n_differ} spike otherwise; output F1 {f1:.3f}" in verdict.reason


@pytest.mark.parametrize(
    ("first", "second", "f1"),
    [
        ((0, 1, 2, 3), (1, 2, 3, 4), 1),  # a whole train a step late
        ((0, 1), (2, 3), 2 / 4),
        ((2, 2, 2), (2,), 2 / 4),  # each is matched once
        ((), (), 1),
        ((5,), (), 0),
    ],
)
def test_f1_of_trains_within_one_step(reference, run, first, second, f1):
    trains = [spikes(*((1, step, 0) for step in steps)) for steps in (first, second)]
    long = replace(reference, n_steps=9, fired=(NONE, trains[0]))
    assert compare(long, replace(run, fired=(NONE, trains[1]))).output_f1 == f1


def test_classifiers_without_layers_are_compared_by_their_decisions(reference, run):
    assert compare(replace(reference, fired=()), replace(run, fired=())).kind == "faithful"


def test_a_run_of_another_size_is_refused(reference, run):
    with pytest.raises(ValueError, match="label must have 3 recordings, got 2"):
        compare(reference, replace(run, label=run.label[:2]))
    with pytest.raises(ValueError, match="fired must have 2 layers, got 0"):
        compare(reference, replace(run, fired=()))


def test_no_recordings_verify_nothing(reference):
    none = {name: getattr(reference, name)[:0] for name in ("label", "time_ms", "decided")}
    verdict = compare(replace(reference, **none, fired=(NONE, NONE)), Run(**none, fired=(NONE, NONE)))
    assert verdict == Verdict("not verified", "there are no recordings")
