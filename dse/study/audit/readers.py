"""Cheap readers: classifiers that train in seconds and answer from whatever tells the classes apart."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping

import numpy as np

from dse.base.native.threads import single_threaded
from dse.base.records import Array, Bools, Floats, Ints
from dse.data.recordings.doubts import nearest_neighbours

Reader = Callable[[Floats, Ints, Floats], Ints]
"""Training features (n, feature), their classes (n,), others (m, feature) -> predicted classes (m,)."""

TREES, NEAREST = "trees", "nearest"
LOGISTIC, NEIGHBOURS, TREE = "logistic", "5 nearest", "tree"
N_TREES = 200


def logistic(x: Floats, codes: Ints, query: Floats) -> Ints:
    """Return what a logistic regression of standardised features answers (L2 penalty, C = 0.1).

    Where no feature varies, that is the most frequent class.
    """
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.linear_model import LogisticRegression

    if len(np.unique(codes)) == 1 or not np.ptp(x, axis=0).any():
        return np.full(len(query), np.bincount(codes).argmax(), np.int64)
    mean, spread = x.mean(axis=0), x.std(axis=0)
    spread = np.where(spread > 0, spread, 1.0)
    with single_threaded(), warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        fitted = LogisticRegression(C=0.1, max_iter=300).fit((x - mean) / spread, codes)
        return np.asarray(fitted.predict((query - mean) / spread))


def tree(x: Floats, codes: Ints, query: Floats) -> Ints:
    """Return what a decision tree with at most four leaves per class answers."""
    from sklearn.tree import DecisionTreeClassifier

    n_leaves = 4 * len(np.unique(codes))
    fitted = DecisionTreeClassifier(max_leaf_nodes=max(2, n_leaves), min_samples_leaf=2, random_state=0)
    return np.asarray(fitted.fit(x, codes).predict(query))


def trees(x: Floats, codes: Ints, query: Floats) -> Ints:
    """Return what extremely randomised trees answer: the same for any number of processes.

    Source: Geurts et al. 2006 (REFERENCES.md).
    """
    from sklearn.ensemble import ExtraTreesClassifier

    fitted = ExtraTreesClassifier(N_TREES, random_state=0).fit(x.astype(np.float32), codes)
    return np.asarray(fitted.predict(query.astype(np.float32)))


READERS: Mapping[str, Reader] = {NEIGHBOURS: nearest_neighbours, LOGISTIC: logistic, TREE: tree}
"""Readers of a few numbers per sample."""


def distances(x: Floats, query: Floats) -> Floats:
    """Return squared Euclidean distances (query, x) of counts, exact below 2**53."""
    return np.asarray((query**2).sum(axis=1)[:, None] + (x**2).sum(axis=1) - 2 * (query @ x.T))


def nearest(squared: Floats, allowed: Bools | None = None) -> Ints:
    """Return the nearest row for every query, (query,) int64; the first of equally near ones.

    squared: (query, row) distances. allowed: (query, row) bool, rows that may answer; -1 where none may.
    """
    if allowed is None:
        return np.asarray(squared.argmin(axis=1))
    place = np.where(allowed, squared, np.inf).argmin(axis=1)
    return np.where(allowed.any(axis=1), place, -1)


def classes_of(codes: Array, place: Ints) -> Ints:
    """Return the class of the row at each place; -1 where there is none."""
    return np.where(place >= 0, codes[place], -1)


COUNT_READERS: Mapping[str, Reader] = {
    TREES: trees,
    NEAREST: lambda x, codes, query: classes_of(codes, nearest(distances(x, query))),
}
"""Readers of spike counts over time, the better of which says what the recordings hold."""


def regions(positions: Ints, side: int) -> Ints:
    """Return the region of every channel, from 0, (n_channels,): a cell of the frame in one plane.

    Channels of no more than side x side are a region each. positions: (n_channels, 3) x, y and plane. side:
    cells along each axis; of channels in a row, side x side along it.
    """
    if len(positions) <= side**2 and side > 1:
        return np.arange(len(positions))
    place = [np.unique(column, return_inverse=True)[1] for column in np.asarray(positions).T]
    n = [int(x.max(initial=0)) + 1 for x in place]
    most = [side**2 if n[1] == 1 else side, side**2 if n[0] == 1 else side, 1 if side == 1 else n[2]]
    cell = [x * min(m, k) // k for x, k, m in zip(place, n, most, strict=True)]
    return np.unique(np.stack(cell, axis=1), axis=0, return_inverse=True)[1].ravel()
