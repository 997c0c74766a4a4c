"""A plan holds every run once, within memory, time and balance, and is as coarse as they allow."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.search.cohorts import Demand, makespan, plan

BUDGET = 100

# Whole numbers, so that sums do not depend on their order.
demands = st.lists(
    st.builds(
        Demand,
        key=st.integers(0, 3),
        memory_bytes=st.integers(0, 60),
        workspace_bytes=st.integers(0, 40),
        cost=st.integers(0, 50).map(float),
    ),
    max_size=24,
)


def alike(n, cost=1.0, memory_bytes=1):
    return [Demand("same", memory_bytes, 10, cost)] * n


def costs(given, cohorts):
    return [sum(given[i].cost for i in cohort) for cohort in cohorts]


@given(demands, st.integers(1, 4), st.sampled_from([0.0, 30.0, 1e9]))
def test_every_run_is_in_one_cohort_that_fits(given, n_workers, longest):
    cohorts = plan(given, BUDGET, n_workers, longest)
    assert sorted(itertools.chain(*cohorts)) == list(range(len(given)))
    for cohort in cohorts:
        members = [given[i] for i in cohort]
        assert len({one.key for one in members}) == 1
        held = sum(one.memory_bytes for one in members) + max(one.workspace_bytes for one in members)
        assert held <= BUDGET
        assert len(members) == 1 or sum(one.cost for one in members) <= longest


@given(demands, st.integers(1, 4), st.sampled_from([0.0, 30.0, 1e9]))
def test_workers_end_as_if_every_run_were_alone(given, n_workers, longest):
    cohorts = plan(given, BUDGET, n_workers, longest)
    taken = costs(given, cohorts)
    assert taken == sorted(taken, reverse=True)
    assert makespan(taken, n_workers) <= 1.02 * makespan([one.cost for one in given], n_workers)


@given(st.lists(st.integers(0, 50), max_size=12), st.integers(1, 4))
def test_the_last_worker_ends_within_grahams_bound(work, n_workers):
    shortest = max(sum(work) / n_workers, max(work, default=0))  # no schedule is shorter
    assert shortest <= makespan(work, n_workers) <= (2 - 1 / n_workers) * shortest


def test_the_last_worker_ends_at():
    assert makespan([3, 3, 2, 2, 2], 2) == 7  # 3 + 2 + 2 and 3 + 2; the best would be 6
    assert makespan([5, 1, 1], 2) == 5
    assert makespan([], 3) == 0


def test_as_few_cohorts_as_there_are_workers():
    assert plan(alike(8), BUDGET, 1, 1e9) == [tuple(range(8))]
    assert [len(cohort) for cohort in plan(alike(8), BUDGET, 2, 1e9)] == [4, 4]
    uneven = [Demand("same", 1, 1, cost) for cost in (9.0, 1.0, 1.0, 2.0, 2.0, 3.0)]
    assert costs(uneven, plan(uneven, BUDGET, 2, 1e9)) == [9.0, 9.0]


def test_each_limit_splits():
    assert [len(c) for c in plan(alike(8, memory_bytes=30), BUDGET, 1, 1e9)] == [3, 3, 2]
    assert [len(c) for c in plan(alike(8, cost=40.0), BUDGET, 1, 120.0)] == [3, 3, 2]
    assert [len(c) for c in plan(alike(3, cost=500.0), BUDGET, 1, 120.0)] == [1, 1, 1]
    apart = [Demand(key, 1, 1, 1.0) for key in "abab"]
    assert plan(apart, BUDGET, 1, 1e9) == [(0, 2), (1, 3)]


def test_a_split_spreads_the_runs_evenly():
    """Three fit into a cohort, but what is left over does not make a cohort of its own."""
    assert [len(c) for c in plan(alike(4, memory_bytes=30), BUDGET, 1, 1e9)] == [2, 2]
    assert [len(c) for c in plan(alike(4, memory_bytes=30), BUDGET, 2, 1e9)] == [2, 2]


def test_work_that_costs_less_than_none_is_no_plan():
    with pytest.raises(AssertionError):  # makespans of such work are never near enough
        plan([*alike(2, cost=-0.5)], BUDGET, 1, 1e9)


def test_a_run_that_no_worker_can_hold_is_refused():
    with pytest.raises(ValueError, match="run 1 needs 101 bytes, but a worker has 100"):
        plan([Demand("a", 90, 10, 1.0), Demand("a", 90, 11, 1.0)], BUDGET, 1, 1e9)
