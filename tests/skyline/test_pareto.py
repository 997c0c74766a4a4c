import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from dse.skyline import pareto

# Few distinct values, so that ties and duplicates are common; both zeros and both infinities.
VALUES = st.sampled_from([0.0, -0.0, 1.0, 2.0, -1.0, 1.7e308, np.inf, -np.inf])
POINTS = hnp.arrays(np.float64, st.tuples(st.integers(0, 30), st.integers(1, 5)), elements=VALUES)


def brute_force(points):
    dominated = [((points <= x).all(axis=1) & (points < x).any(axis=1)).any() for x in points]
    return ~np.array(dominated, dtype=bool)


@given(POINTS)
def test_agrees_with_the_definition(points):
    assert (pareto.non_dominated(points) == brute_force(points)).all()


@given(POINTS, st.randoms(use_true_random=False))
def test_ignores_order_and_added_dominated_points(points, random):
    order = list(range(len(points)))
    random.shuffle(order)
    more = np.concatenate([points[order], np.maximum(points, 0.0) + 1])
    expected = np.concatenate([pareto.non_dominated(points)[order], np.zeros(len(points), dtype=bool)])
    finite = (np.abs(more) < 1e300).all(axis=1)  # where adding 1 makes a difference
    assert (pareto.non_dominated(more)[finite] == expected[finite]).all()


def cloud(kind, n, d, rng):
    noise = rng.random((n, d))
    if kind == "thin slab":
        return noise - noise.mean(axis=1, keepdims=True) + rng.normal(0, 0.02, (n, 1))
    if kind == "correlated":
        return rng.random((n, 1)) + rng.normal(0, 0.05, (n, d))
    if kind == "few values":
        return rng.integers(0, 12, (n, d)).astype(float)
    if kind == "infinities":
        noise[rng.random((n, d)) < 0.1] = np.inf
        noise[rng.random((n, d)) < 0.002] = -np.inf
    return noise


@pytest.mark.parametrize("d", [2, 3, 4, 5])
@pytest.mark.parametrize("kind", ["thin slab", "few values", "infinities"])
def test_the_kernel_alone_agrees_with_the_definition(kind, d):
    points = cloud(kind, 1000, d, np.random.default_rng(d))
    assert (pareto.non_dominated(points) == brute_force(points)).all()


def test_a_large_set_of_equal_points_is_kept_whole():
    assert pareto.non_dominated(np.ones((4096 + 1, 3))).all()


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.int8, np.uint16, np.int64, np.uint64, bool])
def test_points_of_any_real_type(dtype):
    points = np.random.default_rng(0).integers(0, 40, (2 * 4096, 3)).astype(dtype)
    assert (pareto.non_dominated(points) == pareto.non_dominated(points.astype(np.float64))).all()


def test_integers_that_float64_does_not_tell_apart():
    points = np.array([[2**60, 2**60 + 1], [2**60 + 1, 2**60], [2**60 + 1, 2**60 + 1]])
    assert pareto.non_dominated(points).tolist() == [True, True, False]
    assert pareto.non_dominated(-points).tolist() == [False, False, True]
    assert pareto.non_dominated(points[:0]).tolist() == []


def test_order_of_columns_in_memory_does_not_matter():
    points = cloud("uniform", 2 * 4096, 3, np.random.default_rng(0))
    expected = pareto.non_dominated(points)
    assert (pareto.non_dominated(np.asfortranarray(points)) == expected).all()
    assert (pareto.non_dominated(points[::-1])[::-1] == expected).all()


@given(POINTS, st.lists(st.integers(0, 30), max_size=4))
def test_a_front_that_grows_is_the_front_of_everything(points, cuts):
    front = pareto.Front(points.shape[1])
    for keys in np.split(np.arange(len(points)), sorted(cuts)):
        on_front = front.add(points[keys], keys)
        assert set(keys[on_front]) == set(front.keys) & set(keys)
    assert front.keys.tolist() == np.flatnonzero(brute_force(points)).tolist()
    np.testing.assert_array_equal(front.points, points[front.keys])


def test_a_front_takes_points_of_one_length():
    with pytest.raises(ValueError, match=r"points must be \(n, 2\), got shape \(1, 3\)"):
        pareto.Front(2).add(np.zeros((1, 3)), np.zeros(1, np.int64))


def test_input_stays_as_it_was():
    points = np.random.default_rng(0).random((2 * 4096, 2))
    points.flags.writeable = False
    pareto.non_dominated(points)


@pytest.mark.parametrize("kind", ["uniform", "thin slab"])
@pytest.mark.parametrize("d", [2, 3, 5])
def test_nan_in_a_large_set_is_named(kind, d):
    points = cloud(kind, 3 * 4096, d, np.random.default_rng(d))
    points[7001, d - 1] = np.nan
    with pytest.raises(ValueError, match=f"NaN in row 7001, column {d - 1}"):
        pareto.non_dominated(points)


def test_nan_is_named_by_row_and_column():
    with pytest.raises(ValueError, match="NaN in row 1, column 2"):
        pareto.non_dominated([[0, 0, 0], [1, 1, np.nan]])
    with pytest.raises(ValueError, match="NaN in row 0, column 0"):
        pareto.hypervolume([[np.nan]], [1])


@pytest.mark.parametrize("points", [[1.0, 2.0], np.zeros((3, 0)), np.zeros((1, 1, 1))])
def test_points_must_be_a_table(points):
    with pytest.raises(ValueError, match=r"points must be \(n, d\)"):
        pareto.non_dominated(points)


def volume_by_inclusion(points, reference):
    total = 0.0
    for size in range(1, len(points) + 1):
        for subset in itertools.combinations(points, size):
            box = np.prod(np.maximum(np.array(reference) - np.max(subset, axis=0), 0.0))
            total += (-1) ** (size + 1) * box
    return total


@given(
    hnp.arrays(
        np.float64,
        st.tuples(st.integers(0, 6), st.integers(1, 4)),
        elements=st.sampled_from([0.0, 0.25, 0.5, 1.0, 2.0]),
    )
)
def test_hypervolume_agrees_with_inclusion_and_exclusion(points):
    reference = np.ones(points.shape[1])
    assert pareto.hypervolume(points, reference) == pytest.approx(volume_by_inclusion(points, reference))


def test_hypervolume_of_a_staircase():
    assert pareto.hypervolume([[0, 2], [1, 1], [2, 0]], [3, 3]) == 6.0


def test_worst_points_add_nothing():
    assert pareto.hypervolume([[1, 1], [np.inf, 0], [5, 5]], [2, 2]) == 1.0
    assert pareto.hypervolume(np.zeros((0, 3)), [1, 1, 1]) == 0.0


def test_hypervolume_rejects_what_has_no_volume():
    with pytest.raises(ValueError, match="-inf in row 1, column 0"):
        pareto.hypervolume([[0, 0], [-np.inf, 0]], [1, 1])
    with pytest.raises(ValueError, match="reference must be 2 finite numbers"):
        pareto.hypervolume([[0, 0]], [1, 1, 1])
    with pytest.raises(ValueError, match="reference must be 2 finite numbers"):
        pareto.hypervolume([[0, 0]], [1, np.inf])


@given(st.integers(0, 2**31), st.integers(1, 25), st.integers(1, 8))
def test_the_most_telling_points_are_the_best_then_those_that_add_most(seed, n, most):
    rng = np.random.default_rng(seed)
    points, group = rng.integers(0, 9, (n, 2)) / 8 - 0.5, rng.integers(0, 3, n)
    found = pareto.most_telling(points, group, most).tolist()
    assert len(found) == min(n, most) and len(set(found)) == len(found)
    unit = points.copy()
    for number in set(group):
        here = points[group == number]
        unit[group == number] = (here - here.min(axis=0)) / np.where(
            np.ptp(here, axis=0), np.ptp(here, axis=0), 1
        )

    def volume(chosen):
        return sum(
            pareto.hypervolume(unit[[i for i in chosen if group[i] == k]], [1, 1])
            for k in {group[i] for i in chosen}
        )

    n_groups = len(set(group.tolist()))
    for i in found[:n_groups]:
        assert points[i, 0] == points[group == group[i], 0].min()
    for k in range(min(n_groups, most), len(found)):
        others = [volume([*found[:k], i]) for i in range(n) if i not in found[:k]]
        assert volume(found[: k + 1]) == pytest.approx(max(others))
