"""Weights that several synapses share: copies that start equal and move alike.

A matrix of shared weights comes with the number of every synapse's weight, (input, neuron): synapses of one
number hold copies of one weight, and -1 is no synapse, whose weight is 0. The gradient of a shared weight is
the sum over its copies (dse.engine.parameters).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dse.base.records import Array, Floats, Ints


@dataclass(frozen=True)
class Copies:
    """The copies of shared weights among the elements of a flat array.

    number: (element,) int64 number of its weight; `n_weights` where there is none.
    first: (n_weights,) int64 one element of each weight.
    """

    number: Ints
    first: Ints

    @property
    def n_weights(self) -> int:
        return len(self.first)


def copies_of(number: Ints) -> Copies:
    """Return the copies of weights numbered from 0 without gaps, in an array of any shape; -1: none."""
    numbers, first = np.unique(number, return_index=True)
    n_weights = int(numbers[-1]) + 1 if numbers.size else 0
    return Copies(
        np.where(number < 0, n_weights, number).ravel().astype(np.int64), first[numbers >= 0].astype(np.int64)
    )


def expanded(weights: Floats, number: Ints) -> Floats:
    """Return every weight (n,) at all its synapses, in the shape of `number`; 0 where there is none."""
    return np.asarray(np.append(weights, 0)[number])  # -1 is the last


def distinct(weights: Array, number: Ints | None) -> Array:
    """Return the weights of a matrix, (n,), one copy of each that is shared; without numbers, all."""
    return weights.ravel() if number is None else weights.ravel()[copies_of(number).first]
