import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from dse.skyline import thinning

# Few distinct values, so that ties and duplicates are common; both zeros and infinities, overflowing ranges.
VALUES = st.sampled_from([0.0, -0.0, 1.0, 1.5, 2.0, -1.0, 1.7e308, -1.7e308, 5e-324, np.inf, -np.inf])
POINTS = hnp.arrays(np.float64, st.tuples(st.integers(2, 40), st.integers(2, 6)), elements=VALUES)


def brute_force(points):
    dominated = [((points <= x).all(axis=1) & (points < x).any(axis=1)).any() for x in points]
    return ~np.array(dominated, dtype=bool)


@given(POINTS)
def test_passes_keep_every_non_dominated_point(points):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(thinning, "SMALL", 1)
        patch.setattr(thinning, "_BLOCK", 7)
        patch.setattr(thinning, "_WORTHWHILE", 0.01)
        remaining = thinning.thinned(points)
    assert (np.diff(remaining) > 0).all()
    assert set(np.flatnonzero(brute_force(points))) <= set(remaining)
    assert (thinning.exact(points[remaining]) == brute_force(points)[remaining]).all()


@pytest.mark.parametrize("d", [2, 3, 4, 5])
def test_passes_drop_most_of_an_easy_set(d):
    points = np.random.default_rng(0).random((64 * thinning.SMALL, d))
    assert len(thinning.thinned(points)) < 0.05 * len(points)


@pytest.mark.parametrize("d", [2, 3, 5])
def test_an_outlier_or_a_constant_column_costs_nothing_but_time(d):
    points = np.random.default_rng(1).random((3 * thinning.SMALL, d))
    points[5] = 1e300
    points[6, 0] = -1e300
    points[:, -1] = np.floor(points[:, -1])
    assert set(np.flatnonzero(thinning.exact(points))) <= set(thinning.thinned(points))


def test_points_that_nothing_dominates_are_left_to_the_kernel():
    x = np.random.default_rng(2).random((3 * thinning.SMALL, 4))
    slab = np.column_stack([x, 2 - x.sum(axis=1)])
    assert len(thinning.thinned(slab)) == len(slab)


def test_the_number_of_cores_changes_nothing(monkeypatch):
    points = np.random.default_rng(3).random((4 * thinning.SMALL, 3))
    expected = thinning.thinned(points)
    monkeypatch.setattr(thinning, "_BLOCK", 1000)
    assert (thinning.thinned(points) == expected).all()
    monkeypatch.setattr(thinning.os, "sched_getaffinity", lambda _: {0}, raising=False)
    assert (thinning.thinned(points) == expected).all()


@pytest.mark.parametrize("place", [(0, 0), (-1, -1)])
def test_nan_is_seen_wherever_it_is(place, monkeypatch):
    monkeypatch.setattr(thinning, "_BLOCK", 10)
    points = np.full((25, 2), np.inf)
    points[0] = -np.inf
    assert not thinning.has_nan(points)
    points[place] = np.nan
    assert thinning.has_nan(points)
    assert not thinning.has_nan(points[:0])
