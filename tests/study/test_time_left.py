"""The time left, from when runs ended."""

import pytest

from dse.study.progress import TimeLeft, seconds_left


@pytest.mark.parametrize("n_workers", [1, 2, 4])
def test_equal_jobs_are_timed_exactly_and_set_up_does_not_count(n_workers):
    ended_s = [40.0 + 10 * k for k in range(1, 21)]
    for n in range(1, 20):
        left = seconds_left(ended_s[:n], [1.0] * n, 20.0 - n, n_workers, ended_s[n - 1])
        assert left == (None if n < n_workers + 4 else pytest.approx(10 * (20 - n)))


def test_the_runs_of_a_cohort_end_at_one_moment():
    ended_s = [10.0 * job + 0.1 * run for job in range(1, 6) for run in range(8)]
    assert seconds_left(ended_s[:32], [1.0] * 32, 8.0, 1, ended_s[31]) is None
    assert seconds_left(ended_s, [1.0] * 40, 8.0, 1, ended_s[-1]) == pytest.approx(10.0, abs=0.1)


def test_no_estimate_when_nothing_is_missing_or_a_job_outlasts_it():
    ended_s = [10.0 * run for run in range(1, 11)]
    ones = [1.0] * 10
    assert seconds_left(ended_s, ones, 5.0, 1, 100.0) == pytest.approx(50)
    assert seconds_left(ended_s, ones, 5.0, 1, 120.0) == pytest.approx(30)
    assert seconds_left(ended_s, ones, 5.0, 1, 400.0) is None
    assert seconds_left(ended_s, ones, 0.0, 1, 100.0) is None
    assert seconds_left([], [], 5.0, 1, 100.0) is None


def test_runs_that_are_not_planned_yet_count_as_the_mean_and_failures_as_nothing():
    left = TimeLeft(1)
    left.expect(30)
    left.plan([2.0] * 10)
    left.end(0.0, 0.0)  # not trained: the 30 hold 1 untrained, 10 planned and 19 more
    for run in range(10):
        left.end(20.0 * (run + 1), 2.0)
    assert (left.n_ended, left.n_expected) == (11, 30)
    assert left.seconds(200.0) == pytest.approx(19 * 20)
