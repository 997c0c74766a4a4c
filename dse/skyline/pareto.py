"""Non-dominated points and hypervolume of plain arrays, everything minimised.

A point dominates another when it is nowhere worse and somewhere better; equal points do not
dominate each other, so both are on the front. `dse.skyline.front` does the same for tables.
"""

from __future__ import annotations

import moocore
import numpy as np
from numpy.typing import ArrayLike

from dse.records import Bools, Floats, Ints

_SMALL = 16384  # below this many points the kernel alone is faster than filtering first
_SAMPLE = 1024  # points from which a round chooses its pivots
_MAX_PIVOTS = 24  # per round; each costs one comparison of the remaining points
_WORTHWHILE = 0.03  # part of the sample that a pivot must remove to pay for its pass


def _points(points: ArrayLike) -> Floats:
    array = np.asarray(points, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] == 0:
        raise ValueError(f"points must be (n, d) with d >= 1, got shape {array.shape}")
    if not _all_finite(array) and np.isnan(array).any():
        row, column = np.argwhere(np.isnan(array))[0]
        raise ValueError(f"points must not be NaN, got NaN in row {row}, column {column}")
    return array


def _all_finite(array: Floats) -> bool:
    """Return whether there is neither NaN nor infinity: either would reach the sum, in one fast pass."""
    with np.errstate(invalid="ignore", over="ignore"):
        return bool(np.isfinite(array.sum()))


def non_dominated(points: ArrayLike) -> Bools:
    """Return which points no other point dominates; equal points are on the front together.

    Large sets are thinned first: points that dominate much of a small sample remove what they
    dominate in one pass each, and only the rest goes to moocore, whose Kung-Luccio-Preparata
    kernel is O(n log n) for d <= 3 and O(n log^(d-2) n) above. The answer does not depend on it.

    Source: Kung, Luccio and Preparata, J. ACM 22(4), 1975; moocore (REFERENCES.md).

    Args:
        points: (n, d), minimised. +inf is a legal worst value, -inf a legal best one.

    Returns:
        (n,) bool.

    Raises:
        ValueError: a NaN (names row and column), or not two-dimensional.
    """
    array = _points(points)
    if array.shape[1] == 1:
        return np.asarray(array[:, 0] == array.min(initial=np.inf))
    array = _bounded(array)
    if len(array) <= _SMALL:
        return _kernel(array)
    columns = np.ascontiguousarray(array.T)
    remaining, thinned = _thin(columns)
    mask = np.zeros(len(array), dtype=bool)
    mask[remaining[_kernel(np.ascontiguousarray(thinned.T))]] = True
    return mask


def non_dominated_by_group(points: ArrayLike, group: Ints) -> Bools:
    """Return which points no other point of their group dominates, (n,).

    Args:
        points: (n, d), minimised.
        group: (n,) group numbers from 0.

    Raises:
        ValueError: as in `non_dominated`.
    """
    array = _points(points)
    mask = np.zeros(len(array), dtype=bool)
    for members in members_of(group):
        mask[members] = non_dominated(array[members])
    return mask


def members_of(group: Ints) -> list[Ints]:
    """Return the indices, ascending, of the members of each group that has any; groups by number."""
    if not len(group):
        return []
    order = np.argsort(group, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(group[order])) + 1)


def _kernel(array: Floats) -> Bools:
    return np.asarray(moocore.is_nondominated(array, keep_weakly=True), dtype=bool)


def _bounded(array: Floats) -> Floats:
    """Replace the values of columns with infinities by their ranks, which dominate alike.

    moocore 0.3.2 uses infinities as sentinels: it keeps dominated points with +inf and crashes on -inf.
    """
    if _all_finite(array):
        return array
    array = array.copy()
    for column in np.flatnonzero(~np.isfinite(array).all(axis=0)):
        array[:, column] = np.unique(array[:, column], return_inverse=True)[1]
    return array


def _thin(columns: Floats) -> tuple[Ints, Floats]:
    """Return the indices and columns (d, m) left after dropping points that a pivot dominates."""
    remaining = np.arange(columns.shape[1])
    while columns.shape[1] > _SMALL:
        before = columns.shape[1]
        for pivot in _pivots(columns).T:
            left = _not_dominated_by(pivot, columns)
            remaining, columns = remaining[left], columns[:, left]
        if columns.shape[1] > 0.7 * before:
            break
    return remaining, columns


def _not_dominated_by(pivot: Floats, columns: Floats) -> Ints:
    """Return the indices of points that are better than the pivot somewhere, or equal to it."""
    left = columns[0] < pivot[0]
    for column, value in zip(columns[1:], pivot[1:], strict=True):
        left |= column < value
    # The pivot and its duplicates are nowhere better, yet stay; few points share a coordinate with it.
    equal = np.flatnonzero(~left & (columns[0] == pivot[0]))
    left[equal[(columns[:, equal] == pivot[:, None]).all(axis=0)]] = True
    return np.flatnonzero(left)


def _pivots(columns: Floats) -> Floats:
    """Return (d, k) points of an evenly spaced sample that together dominate much of it, best first."""
    sample = columns[:, np.linspace(0, columns.shape[1] - 1, _SAMPLE).astype(np.intp)]
    front = sample[:, _kernel(np.ascontiguousarray(sample.T))]
    candidates = front[:, np.linspace(0, front.shape[1] - 1, min(front.shape[1], 96)).astype(np.intp)]
    covers = np.ones((candidates.shape[1], _SAMPLE), dtype=bool)
    for row, values in zip(candidates, sample, strict=True):
        covers &= row[:, None] <= values
    chosen: list[int] = []
    while len(chosen) < _MAX_PIVOTS:
        gains = covers.sum(axis=1)
        best = int(gains.argmax())
        if gains[best] < _WORTHWHILE * _SAMPLE:
            break
        chosen.append(best)
        covers &= ~covers[best]
    return candidates[:, chosen]


def hypervolume(points: ArrayLike, reference: ArrayLike) -> float:
    """Return the volume between the points and the reference point, dominated by the points.

    Floats that are not better than the reference in every coordinate add nothing.

    Source: moocore (REFERENCES.md); O(n log n) for d <= 3, O(n^2) for d = 4, above that recursive.

    Args:
        points: (n, d), minimised.
        reference: (d,), finite.

    Raises:
        ValueError: NaN or -inf among the points, or a reference of another length or not finite.
    """
    array = _points(points)
    corner = np.asarray(reference, dtype=np.float64)
    if corner.shape != (array.shape[1],) or not np.isfinite(corner).all():
        raise ValueError(f"reference must be {array.shape[1]} finite numbers, got {corner.tolist()}")
    if np.isneginf(array).any():
        row, column = np.argwhere(np.isneginf(array))[0]
        raise ValueError(f"points must be above -inf, got -inf in row {row}, column {column}")
    inside = array[(array < corner).all(axis=1)]
    if len(inside) == 0:
        return 0.0
    if array.shape[1] == 1:
        return float(corner[0] - inside.min())
    return float(moocore.hypervolume(inside, ref=corner))
