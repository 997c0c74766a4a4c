"""Counts of all points of a table in bins: a page draws them behind its sample of the points."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dse.figures.front import numbers
from dse.records import Array
from dse.skyline.table import groups_of

if TYPE_CHECKING:
    import pandas

N_BINS = 40
"""Along each axis: a cell is some 14 pixels wide."""

_DECADES = 2.0


def gather_bins(points: pandas.DataFrame, columns: Sequence[str]) -> list[dict[str, Any]]:
    """Count the points of every task and hardware in the plane of each two columns.

    Edges are even in logarithms where a page's axis is: a positive column that spans two decades.

    Args:
        points: all design points.
        columns: the columns to count in; one with a single value is skipped.

    Returns:
        task and hardware, where the table has them; x and y: columns; x_edges and y_edges: rising;
        counts: [index along x, index along y, number of points] of each cell with points.
    """
    edges = {name: ends for name in columns if (ends := _edges(numbers(points, name))) is not None}
    by = [name for name in ("task", "hardware") if name in points.columns]
    planes: list[dict[str, Any]] = []
    for group in groups_of(points, by) if edges else ():
        about = {name: str(points[name].iloc[group[0]]) for name in by}
        for x, y in itertools.combinations(edges, 2):
            counts, _, _ = np.histogram2d(
                numbers(points, x)[group], numbers(points, y)[group], bins=[edges[x], edges[y]]
            )
            cells = np.argwhere(counts)
            planes.append(
                about
                | {"x": x, "y": y, "x_edges": edges[x].tolist(), "y_edges": edges[y].tolist()}
                | {"counts": [[int(i), int(j), int(counts[i, j])] for i, j in cells]}
            )
    return planes


def _edges(values: Array) -> Array | None:
    """Return the edges of a column's bins; None if it has fewer than two different numbers."""
    finite = values[np.isfinite(values)]
    if not len(finite) or finite.min() == finite.max():
        return None
    low, high = float(finite.min()), float(finite.max())
    if low > 0 and high / low > 10**_DECADES:
        edges = np.geomspace(low, high, N_BINS + 1)
    else:
        edges = np.linspace(low, high, N_BINS + 1)
    edges[[0, -1]] = low, high
    return edges
