"""The time left, on recorded sequences and on ones that are made up."""

import numpy as np
import pytest

from dse.study.progress import TimeLeft, seconds_left

# Seconds after the start at which runs ended; shipped spaces on two workers.
QUICKSTART = (
    *(62.1, 62.3, 62.4, 62.5, 62.5, 62.6, 62.7, 62.7, 62.8, 62.9, 63.1, 63.2),
    *(76.7, 76.8, 76.8, 76.9, 77.0, 77.0, 77.7, 77.7, 77.8, 77.9, 78.0, 78.0),
)
QUICKSTART_ON_AN_IDLE_MACHINE = (
    *(25.8, 25.9, 26.0, 26.1, 26.2, 26.3, 26.5, 26.6, 26.7, 26.8, 26.9, 27.0),
    *(37.5, 37.5, 37.6, 37.6, 37.7, 37.8, 37.8, 37.9, 38.0, 38.0, 38.1, 38.2),
)
FABRIC_TEXTURE = (
    *(3.7, 3.7, 3.8, 3.8, 3.8, 3.9, 3.9, 4.0, 4.0, 4.0, 4.1, 4.1, 4.2, 4.2, 4.2, 4.3),
    *(5.6, 5.7, 5.7, 5.8, 5.8, 5.9, 5.9, 5.9, 6.0, 6.1, 6.2, 6.2, 7.3, 7.4, 7.5, 7.6),
    *(7.6, 7.7, 7.8, 7.9, 8.9, 9.0, 9.1, 9.1, 9.2, 9.2, 9.2, 9.3, 9.4, 9.4, 9.5, 9.6),
)
FAMILIES = (
    *(2.6, 2.6, 2.7, 2.8, 2.8, 2.9, 2.9, 3.0, 3.0, 3.1, 5.4, 5.5, 5.5, 6.2, 6.3, 7.0, 14.0, 14.0, 14.1),
    *(14.9, 15.0, 15.0, 15.1, 15.2, 15.3, 15.4, 15.5, 16.3, 21.0, 21.2, 24.0, 25.4, 25.5, 25.6, 26.4),
    *(26.8, 26.9, 27.2, 27.4, 36.1, 36.5, 36.5, 36.6, 36.6, 36.6, 36.6, 36.9, 36.9, 37.0, 37.0, 37.2),
    *(37.2, 37.3, 37.3, 37.4, 37.4, 37.5, 37.5, 38.8, 38.9, 39.0, 39.0, 39.8, 39.9, 39.9, 40.0, 40.0),
    *(40.0, 49.4, 49.5, 49.6, 50.7, 50.8, 50.9, 51.1, 51.2, 51.2, 51.7, 52.4, 52.5, 52.5, 52.6, 60.5),
    *(60.5, 60.6, 61.3, 61.4, 61.5, 61.7, 61.7, 61.7, 63.0, 63.1, 64.2, 85.6, 86.9, 86.9, 87.0, 87.0),
    *(87.1, 87.3, 88.1, 88.3, 88.7, 88.8, 88.8, 89.1, 89.2, 89.3, 89.4),
)


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


@pytest.mark.parametrize("ended_s", [QUICKSTART, QUICKSTART_ON_AN_IDLE_MACHINE, FABRIC_TEXTURE])
def test_two_cohorts_or_three_are_too_few(ended_s):
    assert estimates(ended_s) == []


def test_an_estimate_of_many_families_is_near_or_there_is_none():
    assert all(abs(estimate - left) <= max(left, 20) for left, estimate in estimates(FAMILIES))


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
