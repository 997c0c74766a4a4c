"""Rank correlation of two columns of design points."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def spearman(x: ArrayLike, y: ArrayLike) -> float:
    """Return Spearman's rank correlation, Pearson's of the ranks; equal values share their mean rank.

    Rows where either is NaN are dropped; infinities rank as the largest and smallest. NaN where it is not
    defined: fewer than 3 rows, or a constant column, whose ranks have no variance.

    Source: Spearman 1904; Brayshaw et al., texture and velocity, section 5.2 (REFERENCES.md).

    Args:
        x: (n,).
        y: (n,).

    Raises:
        ValueError: the columns differ in length.
    """
    import pandas

    a, b = np.asarray(x, np.float64), np.asarray(y, np.float64)
    if a.shape != b.shape or a.ndim != 1:
        raise ValueError(f"columns must be of one length, got {a.shape} and {b.shape}")
    both = ~(np.isnan(a) | np.isnan(b))
    a, b = a[both], b[both]
    if len(a) < 3 or (a == a[0]).all() or (b == b[0]).all():
        return float("nan")
    # Not that of SciPy, whose statistics take a second and 34 MB to import.
    ranks = [pandas.Series(values).rank().to_numpy() for values in (a, b)]
    return float(np.clip(np.corrcoef(np.array(ranks))[0, 1], -1, 1))
