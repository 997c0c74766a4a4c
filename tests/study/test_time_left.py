"""The time left, on sequences of ends that are made up."""

import numpy as np
import pytest

from dse.study.progress import TimeLeft, seconds_left


def estimates(ended_s, work=None, n_workers=2):
    """Return (time left, estimate) at the end of every run at which there is an estimate."""
    work = [1.0] * len(ended_s) if work is None else list(work)
    left = TimeLeft(n_workers, 0.0)
    left.expect(len(ended_s))
    left.plan(work)
    pairs = []
    for at_s, done in zip(ended_s, work, strict=True):
        left.end(at_s, done)
        estimate = left.seconds(at_s)
        if estimate is not None:
            pairs.append((ended_s[-1] - at_s, estimate))
    return pairs


def trained(jobs_s, sizes, n_workers, setup_s, publish_s):
    """Return when the runs of jobs end, and which job each is of."""
    free_s = np.full(n_workers, float(setup_s))
    ends = []
    for job, (takes_s, size) in enumerate(zip(jobs_s, sizes, strict=True)):
        worker = free_s.argmin()
        free_s[worker] += takes_s
        ends += [(free_s[worker] + publish_s * run, job) for run in range(size)]
        free_s[worker] += publish_s * (size - 1)
    ended_s, job = np.array(sorted(ends)).T
    return ended_s, job.astype(int)


@pytest.mark.parametrize("n_workers", [1, 2])
@pytest.mark.parametrize("size", [1, 8])
@pytest.mark.parametrize("seed", range(5))
def test_the_most_expensive_first(n_workers, size, seed):
    rng = np.random.default_rng(seed)
    jobs_s = np.sort(30 * rng.lognormal(0, 0.7, 60))[::-1]
    ended_s, job = trained(jobs_s, [size] * 60, n_workers, 40, 0.1)
    planned = jobs_s * rng.lognormal(0, 0.2, 60)
    pairs = estimates(ended_s, planned[job] / size, n_workers)
    assert len(pairs) > 0.5 * len(ended_s), f"seed {seed}"
    near = [left / 2 <= estimate <= 2 * left for left, estimate in pairs if left > 60]
    assert np.mean(near) > 0.95, f"seed {seed}"


@pytest.mark.parametrize("n_workers", [1, 2, 4])
def test_equal_jobs_are_timed_exactly_and_set_up_does_not_count(n_workers):
    ended_s, _ = trained([10.0] * 40, [1] * 40, n_workers, 40, 0)
    pairs = estimates(ended_s + np.arange(40) * 1e-6, n_workers=n_workers)
    assert len(pairs) >= 7
    assert all(estimate == pytest.approx(left, abs=11) for left, estimate in pairs)


def test_nothing_is_estimated_of_a_rate_that_drifts():
    slower = np.cumsum([10.0] * 8 + [25.0] * 8).tolist()
    ones = [1.0] * 16
    assert seconds_left(slower, ones, 5.0, 1, 0.0, slower[-1]) is None
    assert seconds_left(slower[:8], ones[:8], 5.0, 1, 0.0, slower[7]) == pytest.approx(50)


def test_no_estimate_when_nothing_is_missing_or_a_job_outlasts_it():
    ended_s = [10.0 * run for run in range(1, 11)]
    ones = [1.0] * 10
    assert seconds_left(ended_s, ones, 5.0, 1, 0.0, 100.0) == pytest.approx(50)
    assert seconds_left(ended_s, ones, 5.0, 1, 0.0, 120.0) == pytest.approx(30)
    assert seconds_left(ended_s, ones, 5.0, 1, 0.0, 400.0) is None
    assert seconds_left(ended_s, ones, 0.0, 1, 0.0, 100.0) is None
    assert seconds_left([], [], 5.0, 1, 0.0, 100.0) is None


def test_runs_that_are_not_planned_yet_count_as_the_mean_and_failures_as_nothing():
    left = TimeLeft(1, 0.0)
    left.expect(30)
    left.plan([2.0] * 10)
    left.end(0.0, 0.0)  # not trained: the 30 hold 1 untrained, 10 planned and 19 more
    for run in range(10):
        left.end(20.0 * (run + 1), 2.0)
    assert (left.n_ended, left.n_expected) == (11, 30)
    assert left.seconds(200.0) == pytest.approx(19 * 20)
