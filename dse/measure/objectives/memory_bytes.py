"""Memory that the weights take."""

from __future__ import annotations

import numpy as np

from dse.measure.objectives import objective
from dse.records import Array


@objective(unit="bytes", direction="min")
def memory_bytes(n_weights: Array, bits: Array) -> Array:
    """Memory of the stored weights, W_t times their bits / 8, without indices and without neurons.

    Args:
        n_weights: (...,) stored weights W_t, those that are exactly 0 left out.
        bits: (...,) bits of each.
    """
    return np.asarray(n_weights * bits / 8)
