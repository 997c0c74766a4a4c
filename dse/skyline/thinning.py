"""Dropping dominated points in compiled passes over blocks of rows, and the exact kernel for the rest.

A pass keeps every non-dominated point and drops most others, in time linear in their number. With two or
three coordinates a grid drops points: a point is dominated if its last coordinate is no lower than the least
one in all cells that are strictly lower in the other coordinates. With more, pivots do: points of a sample
that together dominate much of it. Rounds of passes end when one does not pay.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

import moocore
import numpy as np

from dse.native.compiled import compiled
from dse.records import Array, Bools, Floats, Ints

SMALL = 4096
"""Up to this many points the exact kernel alone is as fast."""

_BLOCK = 1 << 17  # rows of a thread at a time
_SAMPLE = 1024  # points of the first round's sample; each round takes _GROWTH times as many
_LARGEST_SAMPLE = 8192
_FIRST_PIVOTS = 32
_MOST_PIVOTS = 512
_GROWTH = 4
_JUDGED = 512  # points of a sample that pivots are judged by
_WORTHWHILE = 0.3  # fraction of the points that a round must drop
_CELLS = {2: 4096, 3: 128}  # along each axis of a grid, at most; coordinates -> cells
_POINTS_PER_CELL = 8
_EVERY = 4  # of so many points one tells a grid what is low
_FAR = 0.99  # fraction of the sample below the upper end of a grid

Result = TypeVar("Result")


class NanError(ValueError):
    """A coordinate is NaN."""


def exact(points: Floats) -> Bools:
    """Return which points no other point dominates, (n,), by moocore's Kung-Luccio-Preparata kernel.

    moocore 0.3.2 uses infinities as sentinels: it keeps dominated points with +inf and crashes on -inf.
    Columns with infinities are replaced by their ranks, which dominate alike.

    Source: Kung, Luccio and Preparata, J. ACM 22(4), 1975; moocore (REFERENCES.md).

    Args:
        points: (n, d), minimised, no NaN.
    """
    bounded = points
    for column in np.flatnonzero(~np.isfinite(points).all(axis=0)):
        bounded = bounded if bounded is not points else points.copy()
        bounded[:, column] = np.unique(points[:, column], return_inverse=True)[1]
    return np.asarray(moocore.is_nondominated(bounded, keep_weakly=True), dtype=bool)


def has_nan(points: Floats) -> bool:
    """Return whether any coordinate of C-contiguous points is NaN."""
    return bool(np.isnan(_in_blocks(len(points), lambda start, stop: points[start:stop].min())).any())


def thinned(points: Floats) -> Ints:
    """Return the indices, ascending, of the points that passes leave; every non-dominated one is among them.

    Args:
        points: (n, d), C-contiguous, minimised, d >= 2; infinities are legal.

    Raises:
        NanError: a coordinate is NaN.
    """
    one_pass = _grid_pass if points.shape[1] in _CELLS else _pivot_pass
    remaining: Ints | None = None
    rows, round_number = points, 0
    while len(rows) > SMALL:
        kept = one_pass(rows, round_number)
        if kept is None:
            break
        remaining = kept if remaining is None else remaining[kept]
        if len(kept) > (1 - _WORTHWHILE) * len(rows):
            break
        rows, round_number = points[remaining], round_number + 1
    if remaining is not None:
        return remaining
    if has_nan(points):
        raise NanError
    return np.arange(len(points))


def _in_blocks(n: int, work: Callable[[int, int], Result], block: int | None = None) -> list[Result]:
    """Return the results of work(start, stop) on all blocks of n rows, in order; all cores share them."""
    step = block or _BLOCK
    blocks = [(start, min(start + step, n)) for start in range(0, n, step)]
    if min(_cores(), len(blocks)) < 2:
        return [work(*each) for each in blocks]
    with ThreadPoolExecutor(min(_cores(), len(blocks))) as pool:
        return list(pool.map(lambda each: work(*each), blocks))


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _kept(n: int, keep: Callable[[int, int, Array], int]) -> Ints:
    """Return the rows that keep(start, stop, out) writes to `out`, of all blocks.

    Rows in `out` count from `start`; the number of them is returned, -1 if any coordinate is NaN.
    """

    def work(start: int, stop: int) -> Ints:
        out = np.empty(stop - start, np.int32)
        count = keep(start, stop, out)
        if count < 0:
            raise NanError
        return out[:count] + np.int64(start)

    return np.concatenate(_in_blocks(n, work))


def _sample(points: Floats, n: int) -> Floats:
    """Return n evenly spaced points."""
    return points[np.linspace(0, len(points) - 1, n).astype(np.intp)]


def _pivot_pass(points: Floats, round_number: int) -> Ints | None:
    """Return the rows that no pivot dominates; None if the pivots would drop too few."""
    n_sample = min(_SAMPLE * _GROWTH**round_number, _LARGEST_SAMPLE, len(points) // 2)
    n_pivots = min(_FIRST_PIVOTS * _GROWTH**round_number, _MOST_PIVOTS)
    pivots = _pivots(_sample(points, n_sample), n_pivots)
    if not len(pivots):
        return None
    return _kept(len(points), lambda start, stop, out: _not_below(points, start, stop, pivots, out))


def _pivots(sample: Floats, n: int) -> Floats:
    """Return at most n points of a sample, best first; none if they dominate too little of it.

    The first ones are chosen one after the other, each by what it dominates in addition.
    """
    front = sample[exact(sample)]
    candidates = _sample(front, min(len(front), 3 * n))
    judged = _sample(sample, _JUDGED)
    dominates = np.ones((len(candidates), len(judged)), dtype=bool)
    for row, values in zip(candidates.T, judged.T, strict=True):
        dominates &= row[:, None] <= values
    by_number = np.argsort(-dominates.sum(axis=1), kind="stable")
    if dominates[by_number[:n]].any(axis=0).mean() < _WORTHWHILE:
        return candidates[:0]
    chosen: list[int] = []
    while len(chosen) < min(n, _FIRST_PIVOTS):
        gains = dominates.sum(axis=1)
        best = int(gains.argmax())
        if gains[best] == 0:
            break
        chosen.append(best)
        dominates &= ~dominates[best]
    others = by_number[~np.isin(by_number, chosen)][: n - len(chosen)]
    return np.ascontiguousarray(candidates[[*chosen, *others]])


def _grid_pass(points: Floats, round_number: int) -> Ints | None:
    """Return the rows that no lower cell of a grid over all but the last coordinate dominates."""
    n, d = points.shape
    n_cells = max(1, int(min(_CELLS[d], (n / _POINTS_PER_CELL) ** (1 / (d - 1)))))
    low, scale = _grid(_sample(points, _SAMPLE)[:, :-1], n_cells)
    lowest, above = (_lowest_2, _above_2) if d == 2 else (_lowest_3, _above_3)

    def table(start: int, stop: int) -> Floats:
        least = np.full((n_cells,) * (d - 1), np.inf)
        lowest(points, start, stop, low, scale, least)
        return least

    least = np.minimum.reduce(_in_blocks(n, table, max(_BLOCK, -(-n // _cores()))))
    for axis in range(d - 1):
        np.minimum.accumulate(least, axis=axis, out=least)
    below = np.full_like(least, np.inf)
    below[(slice(1, None),) * (d - 1)] = least[(slice(None, -1),) * (d - 1)]
    return _kept(n, lambda start, stop, out: above(points, start, stop, low, scale, below, out))


def _grid(sample: Floats, n_cells: int) -> tuple[Floats, Floats]:
    """Return lower ends and cells per unit, (axis,) each; both are finite, whatever the sample."""
    low, scale = np.zeros(sample.shape[1]), np.zeros(sample.shape[1])
    for axis, values in enumerate(sample.T):
        finite = np.sort(values[np.isfinite(values)])
        if len(finite):
            low[axis], far = finite[0], finite[int(_FAR * (len(finite) - 1))]
            with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
                scale[axis] = n_cells / (far - finite[0])
    return low, np.where(np.isfinite(scale), scale, 0.0)


@compiled(_nrt=False)
def _not_below(points: Any, start: Any, stop: Any, pivots: Any, out: Any) -> Any:
    """Write the rows that no pivot dominates; return their number."""
    n_pivots, d = pivots.shape
    count = 0
    is_nan = False
    for i in range(start, stop):
        for j in range(d):
            is_nan |= points[i, j] != points[i, j]
        dominated = False
        for p in range(n_pivots):
            j = 0
            while j < d and points[i, j] >= pivots[p, j]:
                j += 1
            if j == d:
                for k in range(d):
                    dominated |= points[i, k] > pivots[p, k]
                if dominated:
                    break
        out[count] = i - start
        count += not dominated
    return -1 if is_nan else count


@compiled(inline="always", _nrt=False)
def _cell(x: Any, low: Any, scale: Any, n: Any) -> Any:
    """Return the cell of a coordinate: never a higher one for a lower coordinate, rounding included."""
    place = (x - low) * scale
    return np.int64(min(place, n - 1.0)) if place > 0 else np.int64(0)


@compiled(_nrt=False)
def _lowest_2(points: Any, start: Any, stop: Any, low: Any, scale: Any, least: Any) -> None:
    n = least.shape[0]
    a, by_a = low[0], scale[0]
    for i in range(start, stop, _EVERY):
        cell = _cell(points[i, 0], a, by_a, n)
        least[cell] = min(least[cell], points[i, 1])


@compiled(_nrt=False)
def _lowest_3(points: Any, start: Any, stop: Any, low: Any, scale: Any, least: Any) -> None:
    n = least.shape[0]
    a, b, by_a, by_b = low[0], low[1], scale[0], scale[1]
    for i in range(start, stop, _EVERY):
        row, column = _cell(points[i, 0], a, by_a, n), _cell(points[i, 1], b, by_b, n)
        least[row, column] = min(least[row, column], points[i, 2])


@compiled(_nrt=False)
def _above_2(points: Any, start: Any, stop: Any, low: Any, scale: Any, below: Any, out: Any) -> Any:
    """Write the rows below the bound of their cell; no point lies below a cell whose bound is infinite."""
    n = below.shape[0]
    a, by_a = low[0], scale[0]
    count = 0
    is_nan = False
    for i in range(start, stop):
        x, y = points[i, 0], points[i, 1]
        is_nan |= x != x or y != y
        bound = below[_cell(x, a, by_a, n)]
        out[count] = i - start
        count += y < bound or bound == np.inf
    return -1 if is_nan else count


@compiled(_nrt=False)
def _above_3(points: Any, start: Any, stop: Any, low: Any, scale: Any, below: Any, out: Any) -> Any:
    n = below.shape[0]
    a, b, by_a, by_b = low[0], low[1], scale[0], scale[1]
    count = 0
    is_nan = False
    for i in range(start, stop):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        is_nan |= x != x or y != y or z != z
        bound = below[_cell(x, a, by_a, n), _cell(y, b, by_b, n)]
        out[count] = i - start
        count += z < bound or bound == np.inf
    return -1 if is_nan else count
