"""Which class was taken for which."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def confusion(label: ArrayLike, target: ArrayLike, n_classes: int) -> NDArray[np.int64]:
    """Return how many samples of each true class (row) got each answer (column).

    Args:
        label: (n,) answers in 0..n_classes - 1.
        target: (n,) true classes.
        n_classes: size of the matrix.

    Raises:
        ValueError: different lengths, or a class out of range.
    """
    answers, truth = np.asarray(label), np.asarray(target)
    if answers.shape != truth.shape or answers.ndim != 1:
        raise ValueError(f"label and target must be (n,), got {answers.shape} and {truth.shape}")
    for name, codes in (("label", answers), ("target", truth)):
        if codes.size and not (0 <= codes.min() and codes.max() < n_classes):
            raise ValueError(f"{name} must be in 0..{n_classes - 1}, got {codes.min()}..{codes.max()}")
    counts = np.bincount(
        truth.astype(np.int64) * n_classes + answers.astype(np.int64), minlength=n_classes**2
    )
    return counts.reshape(n_classes, n_classes)
