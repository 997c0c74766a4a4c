"""Who goes on from a rung: by hand, against the definition written out, and hard cases."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from dse.search.racing import best
from dse.skyline.pareto import hypervolume, non_dominated

ROWS = st.lists(st.tuples(*[st.integers(0, 5)] * 3), min_size=1, max_size=12)


def written_out(costs, n):
    """Return the n best: fronts one after the other, the last one by the hypervolume that is added."""
    left, chosen = list(range(len(costs))), []
    while left and len(chosen) < n:
        front = [place for place, is_best in zip(left, non_dominated(costs[left]), strict=True) if is_best]
        left = [place for place in left if place not in front]
        if len(chosen) + len(front) <= n:
            chosen += front
            continue
        rows = costs[front]
        span = np.ptp(rows, axis=0)
        scaled = dict(zip(front, (rows - rows.min(axis=0)) / np.where(span > 0, span, 1), strict=True))
        of_front = []
        while len(chosen) + len(of_front) < n:
            volumes = {
                place: round(hypervolume([scaled[x] for x in (*of_front, place)], [1.01] * 3), 12)
                for place in front
                if place not in of_front
            }
            of_front.append(min(volumes, key=lambda place: (-volumes[place], place)))
        chosen += of_front
    return set(chosen)


@given(ROWS, st.integers(1, 12))
def test_fronts_go_on_one_after_the_other_and_the_last_by_hypervolume(rows, n):
    costs = np.array(rows, float)
    chosen = best(costs, n)
    assert len(chosen) == min(n, len(rows)) and (np.diff(chosen) > 0).all()
    assert set(chosen.tolist()) == written_out(costs, n)


def test_by_hand():
    # A front of four, of which the two in the middle are close together, and a point behind it.
    costs = np.array([[0, 10.0], [4, 5.0], [5, 4.0], [10, 0.0], [6, 6.0]])
    assert best(costs, 4).tolist() == [0, 1, 2, 3]
    assert best(costs, 5).tolist() == best(costs, 9).tolist() == [0, 1, 2, 3, 4]
    assert best(costs, 1).tolist() == [1]  # (1.01 - 0.4)(1.01 - 0.5), the first of two equal ones
    assert best(costs, 2).tolist() == [1, 2]  # 0.1 x 0.51 more; an end adds 0.01 x 0.4 or so
    assert best(costs, 0).tolist() == []


def test_equal_designs_and_one_objective():
    assert best(np.zeros((4, 2)), 2).tolist() == [0, 1]
    assert best(np.array([[3.0], [1.0], [2.0], [1.0]]), 3).tolist() == [1, 2, 3]
    assert best(np.zeros((0, 3)), 2).tolist() == []
    many = np.random.default_rng(0).random((3000, 3))
    assert set(np.flatnonzero(non_dominated(many))) >= set(best(many, 40).tolist())
