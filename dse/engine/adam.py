"""Adam (Kingma and Ba 2015, REFERENCES.md): the definition of what the engines fuse."""

from __future__ import annotations

import numpy as np

from dse.records import Array

BETA_1, BETA_2, EPSILON = 0.9, 0.999, 1e-8


def adam(
    weights: Array, gradient: Array, first: Array, second: Array, step: int, rate: Array
) -> tuple[Array, Array, Array]:
    """Return weights and both moments after an update.

    Args:
        weights: float32.
        gradient: of the loss by the weights, their shape.
        first: mean of the gradients, begins at 0.
        second: mean of their squares, begins at 0.
        step: number of this update, from 1.
        rate: learning rate, one number or one per column.
    """
    first = first + np.float32(1 - BETA_1) * (gradient - first)
    second = second + np.float32(1 - BETA_2) * (gradient * gradient - second)
    size = np.float32(1 / (1 - BETA_1**step)) * rate
    correction = np.float32(1 / (1 - BETA_2**step))
    moved = weights - size * first / (np.sqrt(second * correction) + np.float32(EPSILON))
    return moved.astype(np.float32), first.astype(np.float32), second.astype(np.float32)
