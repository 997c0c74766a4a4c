"""Cheap readers: classifiers that train in seconds and answer from whatever tells the classes apart."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping

import numpy as np

from dse.recordings.leakage import nearest_neighbours
from dse.records import Array, Bools, Floats, Ints

Reader = Callable[[Floats, Ints, Floats], Ints]
"""Training features (n, feature), their classes (n,), others (m, feature) -> predicted classes (m,)."""

LOGISTIC, NEAREST, NEIGHBOURS, TREE = "logistic", "nearest", "5 nearest", "tree"


def logistic(x: Floats, codes: Ints, query: Floats) -> Ints:
    """Return what a logistic regression of standardised features answers (L2 penalty, C = 0.1).

    Where no feature varies, that is the most frequent class.
    """
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.linear_model import LogisticRegression
    from threadpoolctl import threadpool_limits

    if len(np.unique(codes)) == 1 or not np.ptp(x, axis=0).any():
        return np.full(len(query), np.bincount(codes).argmax(), np.int64)
    mean, spread = x.mean(axis=0), x.std(axis=0)
    spread = np.where(spread > 0, spread, 1.0)
    with threadpool_limits(1), warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        train, other = _in_span((x - mean) / spread, (query - mean) / spread)
        return np.asarray(LogisticRegression(C=0.1, max_iter=300).fit(train, codes).predict(other))


def _in_span(x: Floats, query: Floats) -> tuple[Floats, Floats]:
    """Return both in coordinates of the space that the rows of x span, where it has fewer dimensions.

    The weights of a linear reader with an L2 penalty lie in that space, so that the reader stays the same.
    """
    if x.shape[1] <= x.shape[0]:
        return x, query
    values, vectors = np.linalg.eigh(x @ x.T)
    present = values > 1e-9 * values[-1]
    basis = x.T @ (vectors[:, present] / np.sqrt(values[present]))
    return x @ basis, query @ basis


def tree(x: Floats, codes: Ints, query: Floats) -> Ints:
    """Return what a decision tree with at most four leaves per class answers."""
    from sklearn.tree import DecisionTreeClassifier

    n_leaves = 4 * len(np.unique(codes))
    fitted = DecisionTreeClassifier(max_leaf_nodes=max(2, n_leaves), min_samples_leaf=2, random_state=0)
    return np.asarray(fitted.fit(x, codes).predict(query))


READERS: Mapping[str, Reader] = {NEIGHBOURS: nearest_neighbours, LOGISTIC: logistic, TREE: tree}
"""Readers of a few numbers per sample."""


def distances(x: Floats, query: Floats) -> Floats:
    """Return squared Euclidean distances (query, x) of counts, exact below 2**53."""
    return np.asarray((query**2).sum(axis=1)[:, None] + (x**2).sum(axis=1) - 2 * (query @ x.T))


def nearest(squared: Floats, allowed: Bools | None = None) -> Ints:
    """Return the nearest row for every query, (query,) int64; the first of equally near ones.

    Args:
        squared: (query, row) distances.
        allowed: (query, row) bool, rows that may answer; -1 is returned where none may.
    """
    if allowed is None:
        return np.asarray(squared.argmin(axis=1))
    place = np.where(allowed, squared, np.inf).argmin(axis=1)
    return np.where(allowed.any(axis=1), place, -1)


def classes_of(codes: Array, place: Ints) -> Ints:
    """Return the class of the row at each place; -1 where there is none."""
    return np.where(place >= 0, codes[place], -1)
