"""Non-dominated points and hypervolume of plain arrays, everything minimised.

A point dominates another when it is nowhere worse and somewhere better; equal points do not
dominate each other, so both are on the front. `dse.skyline.front` does the same for tables.
"""

from __future__ import annotations

import heapq

import moocore
import numpy as np
from numpy.typing import ArrayLike

from dse.base.records import Bools, Floats, Ints

_EXACT_INTEGERS = 2**53  # up to here float64 tells all integers apart


def _points(points: ArrayLike) -> Floats:
    """Return points as C-contiguous float64 that dominate alike."""
    array = np.asarray(points)
    if array.ndim != 2 or array.shape[1] == 0:
        raise ValueError(f"points must be (n, d) with d >= 1, got shape {array.shape}")
    if array.dtype.kind in "iu" and array.dtype.itemsize == 8 and array.size:
        if int(array.max()) > _EXACT_INTEGERS or int(array.min()) < -_EXACT_INTEGERS:
            array = np.stack([np.unique(x, return_inverse=True)[1] for x in array.T], axis=1)
    return np.ascontiguousarray(array, dtype=np.float64)


def _without_nan(array: Floats) -> Floats:
    if np.isnan(array.min(initial=0)):
        row, column = np.argwhere(np.isnan(array))[0]
        raise ValueError(f"points must not be NaN, got NaN in row {row}, column {column}")
    return array


def non_dominated(points: ArrayLike) -> Bools:
    """Return which points no other point dominates; equal points are on the front together.

    O(n log n) for d <= 3 and O(n log^(d-2) n) above, by moocore's Kung-Luccio-Preparata kernel. moocore 0.3.2
    uses infinities as sentinels: it keeps dominated points with +inf and crashes on -inf. Columns with
    infinities are replaced by their ranks, which dominate alike.

    Source: Kung, Luccio and Preparata, J. ACM 22(4), 1975; moocore (REFERENCES.md).

    Args:
        points: (n, d), minimised, of any real type. +inf is a legal worst value, -inf a legal best one.

    Returns:
        (n,) bool.

    Raises:
        ValueError: a NaN (names row and column), or not two-dimensional.
    """
    array = _without_nan(_points(points))
    if array.shape[1] == 1:
        return np.asarray(array[:, 0] == array.min(initial=np.inf))
    bounded = array
    for column in np.flatnonzero(~np.isfinite(array).all(axis=0)):
        bounded = bounded if bounded is not array else array.copy()
        bounded[:, column] = np.unique(array[:, column], return_inverse=True)[1]
    return np.asarray(moocore.is_nondominated(bounded, keep_weakly=True), dtype=bool)


class Front:
    """The non-dominated points among all that were added so far.

    points: (k, d), in the order of adding.
    keys: (k,) the numbers that they were added with.
    """

    def __init__(self, d: int) -> None:
        self.points: Floats = np.empty((0, d))
        self.keys: Ints = np.empty(0, np.int64)

    def add(self, points: ArrayLike, keys: Ints) -> Bools:
        """Add points and return which of them are on the front now, (n,).

        The cost depends on the number of new points and on the front, not on the points that have left it.

        Args:
            points: (n, d), as in `non_dominated`, float or small integers.
            keys: (n,) numbers that identify them.

        Raises:
            ValueError: as in `non_dominated`, or points of another length.
        """
        block = np.asarray(points, np.float64)
        if block.ndim != 2 or block.shape[1] != self.points.shape[1]:
            raise ValueError(f"points must be (n, {self.points.shape[1]}), got shape {block.shape}")
        best = np.flatnonzero(non_dominated(block))
        both = np.concatenate([self.points, block[best]])
        stays = non_dominated(both)
        self.keys = np.concatenate([self.keys, keys[best]])[stays]
        n_before, self.points = len(self.points), both[stays]
        mask = np.zeros(len(block), dtype=bool)
        mask[best[stays[n_before:]]] = True
        return mask


def non_dominated_by_group(points: ArrayLike, group: Ints) -> Bools:
    """Return which points no other point of their group dominates, (n,).

    Args:
        points: (n, d), minimised.
        group: (n,) group numbers from 0.
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
    array = _without_nan(_points(points))
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


def most_telling(points: ArrayLike, group: Ints, n: int) -> Ints:
    """Return at most n points, the most telling first.

    These are the best of each group in the first coordinate, then those that add the most hypervolume to the
    ones before. The hypervolume is that of the point's group, over the ranges of its points; a coordinate
    that varies by more than a factor of ten counts by its logarithm.

    Source: Guerreiro, Fonseca and Paquete, Evol. Comput. 24(3), 2016 (greedy subsets); gains only shrink, so
    that one is computed again only where it was the largest.

    Args:
        points: (n, d), minimised, finite.
        group: (n,) group numbers.
        n: number of points.
    """
    unit = _points(points).copy()
    order: list[int] = []
    for members in members_of(group):
        order.append(int(members[unit[members, 0].argmin()]))
        for column in range(unit.shape[1]):
            values = unit[members, column]
            if values.min() > 0 and values.max() > 10 * values.min():
                values = np.log(values)
            unit[members, column] = (values - values.min()) / (np.ptp(values) or 1.0)
    corner = np.ones(unit.shape[1])
    chosen = {int(group[i]): [i] for i in order}
    volumes = {number: hypervolume(unit[members], corner) for number, members in chosen.items()}
    heap = [(-float(volume), i) for i, volume in enumerate(np.prod(1 - unit, axis=1)) if i not in order]
    heapq.heapify(heap)
    while heap and len(order) < n:
        _, i = heapq.heappop(heap)
        number = int(group[i])
        volume = hypervolume(unit[[*chosen[number], i]], corner)
        gain = volume - volumes[number]
        if heap and (-gain, i) > heap[0]:
            heapq.heappush(heap, (-gain, i))
            continue
        order.append(i)
        chosen[number].append(i)
        volumes[number] = volume
    return np.array(order[:n], np.int64)
