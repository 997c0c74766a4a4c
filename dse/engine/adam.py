"""Adam (Kingma and Ba 2015, REFERENCES.md): the definition of what the engines fuse."""

from __future__ import annotations

from typing import Any, TypeVar

A = TypeVar("A", bound=Any)
"""An array of numpy or a tensor of torch."""

BETA_1, BETA_2, EPSILON = 0.9, 0.999, 1e-8


def adam(weights: A, gradient: A, first: A, second: A, step: int, rate: A | float) -> tuple[A, A, A]:
    """Return weights and both moments after an update.

    Args:
        weights: float32.
        gradient: of the loss by the weights, their shape.
        first: mean of the gradients, begins at 0.
        second: mean of their squares, begins at 0.
        step: number of this update, from 1.
        rate: learning rate, one number or one per column.
    """
    first = first + (1 - BETA_1) * (gradient - first)
    second = second + (1 - BETA_2) * (gradient * gradient - second)
    size = 1 / (1 - BETA_1**step) * rate
    correction = 1 / (1 - BETA_2**step)
    return weights - size * first / ((second * correction) ** 0.5 + EPSILON), first, second
