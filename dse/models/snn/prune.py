"""Magnitude pruning: which weights stay.

Source: Han et al. 2015, learning both weights and connections (REFERENCES.md).
"""

from __future__ import annotations

import numpy as np

from dse.engine.member import Masters
from dse.neurons.fixed_point import quantise
from dse.records import Arithmetic, Array


def largest(weights: Array, pruned: float) -> Array:
    """Return the weights that stay, as booleans, where a share of a matrix is removed, smallest first.

    Of equal magnitudes the first in the matrix goes first; the number removed is rounded down.
    """
    removed = int(pruned * weights.size)
    kept = np.ones(weights.size, bool)
    kept[np.argsort(np.abs(weights), axis=None, kind="stable")[:removed]] = False
    return kept.reshape(weights.shape)


def masks(masters: Masters, pruned: float) -> Masters:
    """Return `largest` of every matrix, as booleans in place of its weights."""
    return Masters(
        tuple(largest(w, pruned) for w in masters.feed_forward),
        tuple(None if r is None else largest(r, pruned) for r in masters.recurrent),
    )


def remaining(weights: Array, kept: Array, arithmetic: Arithmetic) -> Array:
    """Return weights as they are stored after pruning: 0 where removed, or where 8 bits round them to 0."""
    stored = np.where(kept, weights, np.float32(0))
    if arithmetic == "integer":
        stored[quantise(stored) == 0] = 0
    return stored
