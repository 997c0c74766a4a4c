"""Where a recording's pins are: the columns and rows of the frame that have more events than the rest."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from dse.base.records import Block, Floats, Ints


def count_pixels(blocks: Iterable[Block], width: int, height: int) -> tuple[Ints, Ints]:
    """Return the events of every column, (width,) int64, and of every row, (height,) int64."""
    columns, rows = np.zeros(width, dtype=np.int64), np.zeros(height, dtype=np.int64)
    for block in blocks:
        columns += np.bincount(block.x, minlength=width)
        rows += np.bincount(block.y, minlength=height)
    return columns, rows


def pin_rectangle(column_counts: Ints, row_counts: Ints) -> tuple[int, int, int, int]:
    """Return x, y, width, height from the first to the last column and row that see pins.

    A column or row sees pins where log(1 + count) is above Otsu's threshold. The logarithm keeps the border
    between noise and pins where few pins, or a single broken pixel, would move it. If all
    counts are equal, every column or row is kept.
    """
    (x, width), (y, height) = _span(column_counts), _span(row_counts)
    return x, y, width, height


def _span(counts: Ints) -> tuple[int, int]:
    levels = np.log1p(counts)
    above = np.flatnonzero(levels > otsu(levels))
    return (int(above[0]), int(above[-1] - above[0] + 1)) if len(above) else (0, len(counts))


def otsu(values: Floats) -> float:
    """Return the threshold that separates values, (n,), best into two classes: the largest of the lower one.

        maximise  n_low n_high (mean_high - mean_low)^2,   low: values <= threshold

    The first of equal splits counts; values that are all the same are all low.

    Source: N. Otsu, A threshold selection method from gray-level histograms, IEEE Transactions on Systems,
    Man, and Cybernetics 9 (1979) 62-66.
    """
    ordered = np.sort(values)
    n_low = np.arange(1, len(ordered))
    total = np.cumsum(ordered)
    low, high = total[:-1] / n_low, (total[-1] - total[:-1]) / (len(ordered) - n_low)
    between = np.where(ordered[1:] > ordered[:-1], n_low * (len(ordered) - n_low) * (high - low) ** 2, 0.0)
    return float(ordered[between.argmax()] if between.any() else ordered[-1])
