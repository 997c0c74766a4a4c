"""k nearest neighbours against a plain definition and scikit-learn."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from dse.models.counts.knn import KNN, squared_distances, vote
from dse.models.training import Training
from tests.models.counted import rngs, textures

numbers = dict(
    seed=st.integers(0, 10**6), n=st.integers(1, 25), features=st.integers(1, 4), k=st.integers(1, 30)
)


def drawn(seed, n, features):
    """Counts 0 to 4: equal distances everywhere."""
    rng = np.random.default_rng(seed)
    shape = (20, 1, features), (n, 1, features)
    return *(rng.integers(0, 5, each).astype(np.int32) for each in shape), rng.integers(0, 4, n)


def voted_slowly(query, stored, target, k):
    """Sort by (distance, place), count, take the lowest of the leading classes."""
    order = sorted(range(len(stored)), key=lambda i: (((stored[i] - query) ** 2).sum(), i))[:k]
    votes = [int(target[i]) for i in order]
    return min(set(votes), key=lambda c: (-votes.count(c), c))


@given(**numbers)
def test_uniform_votes_are_those_of_the_definition(seed, n, features, k):
    queries, stored, target = drawn(seed, n, features)
    found = vote(squared_distances(queries, stored), target, k, "uniform")
    assert found.tolist() == [voted_slowly(query, stored, target, k) for query in queries]


@pytest.mark.parametrize("weights", ["uniform", "distance"])
@given(**numbers)
def test_votes_are_those_of_scikit_learn_where_it_says_whose_count(weights, seed, n, features, k):
    from sklearn.neighbors import KNeighborsClassifier

    queries, stored, target = drawn(seed, n, features)
    k = min(k, n)
    squared = squared_distances(queries, stored)
    ranked = np.sort(squared, axis=1)
    # scikit-learn leaves open which of several equally distant samples are among the k.
    clear = np.ones(20, bool) if k == n else ranked[:, k - 1] < ranked[:, k]
    assume(clear.any())
    known = KNeighborsClassifier(k, weights=weights, algorithm="brute")
    expected = known.fit(stored[:, 0].astype(float), target).predict(queries[:, 0].astype(float))
    found = vote(squared, target, k, weights)
    if weights == "distance":
        # Sums of 1 / distance in another order may break a tie by their last bit.
        near = np.argsort(squared, axis=1, kind="stable")[:, :k]
        for i in range(20):
            weight = 1 / np.sqrt(np.maximum(squared[i, near[i]], 1e-300))
            share = np.sort([weight[target[near[i]] == c].sum() for c in np.unique(target)])
            clear[i] &= len(share) < 2 or share[-1] - share[-2] > 1e-9 * share[-1] or share[-1] > 1e100
    assert found[clear].tolist() == expected[clear].tolist()


def test_ties_by_hand():
    squared = np.array([[4, 1, 1, 4, 9]])
    target = np.array([0, 2, 1, 0, 0])
    assert vote(squared, target, 1, "uniform").tolist() == [2]  # of two at distance 1 the first
    assert vote(squared, target, 2, "uniform").tolist() == [1]  # one vote each: the lowest class
    assert vote(squared, target, 3, "uniform").tolist() == [0]  # and of two at distance 2 the first
    assert vote(squared, target, 4, "uniform").tolist() == [0]
    assert vote(squared, target, 4, "distance").tolist() == [0]  # 1/2 + 1/2 against 1 and 1
    assert vote(np.array([[0, 1, 1]]), np.array([2, 0, 0]), 3, "distance").tolist() == [2]
    assert vote(np.array([[0, 0, 1]]), np.array([2, 1, 1]), 3, "distance").tolist() == [1]


def test_more_neighbours_than_samples():
    squared = np.array([[1, 2, 3]])
    assert vote(squared, np.array([0, 1, 1]), 99, "uniform").tolist() == [1]


@given(st.integers(0, 10**6))
def test_distances_are_whole_numbers(seed):
    rng = np.random.default_rng(seed)
    a, b = (rng.integers(0, 100_000, (3, 2, 5)) for _ in range(2))
    expected = [[sum(Fraction(int(v)) ** 2 for v in (x - y).ravel()) for y in b] for x in a]
    assert squared_distances(a, b).tolist() == expected


def test_every_length_is_scikit_learn_on_that_length():
    from sklearn.neighbors import KNeighborsClassifier

    data = textures()
    family = KNN(window_ms=50.0, channels="each", k=30)  # all vote: no tie is left open
    outcome = family.fit(data, Training(), rngs)
    stored = outcome.network.arrays["counts"].reshape(30, -1).astype(float)
    queries = family.counts(data, data.validation, {}).reshape(24, -1).astype(float)
    for j in range(5):
        seen = slice(0, 4 * (j + 1))
        known = KNeighborsClassifier(30, algorithm="brute").fit(stored[:, seen], data.target[data.train])
        assert np.array_equal(outcome.validation.label[:, j], known.predict(queries[:, seen]))


def test_many_queries_are_answered_in_batches(monkeypatch):
    data = textures()
    whole = KNN(window_ms=50.0).fit(data, Training(), rngs).validation.label
    monkeypatch.setattr("dse.models.counts.knn._BATCH", 7)
    assert np.array_equal(whole, KNN(window_ms=50.0).fit(data, Training(), rngs).validation.label)
