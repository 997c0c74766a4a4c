"""Memory that the weights take."""

from __future__ import annotations

import numpy as np

from dse.measure.objectives import objective
from dse.records import Array


@objective(unit="bytes", direction="min")
def memory_bytes(n_weights: Array, bits: Array) -> Array:
    """Memory of the weights: W_t times the bits per weight / 8; indices and neuron states are not counted.

    Args:
        n_weights: (...,) stored weights W_t, those that are exactly 0 left out.
        bits: (...,) bits of each.
    """
    return np.asarray(n_weights * bits / 8)
