"""Memory that the weights take."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dse.measure.objectives import Points
from dse.records import Floats, Ints
from dse.registry import Column, register


@register("objectives", "memory_bytes")
@dataclass(frozen=True)
class MemoryBytes:
    """Memory of the stored weights."""

    needs = "points"
    columns = (
        Column(
            "memory_bytes",
            "bytes",
            "min",
            "Memory of the weights: W_t times the bits per weight (and per delay of a synapse where synapses "
            "have one) / 8; indices and neuron states are not counted.",
            of_design=True,
            known="exact",
        ),
    )

    def measure(self, points: Points) -> Mapping[str, Floats]:
        return {"memory_bytes": memory_bytes(points.n_weights, np.array(points.load.number_bits))}


def memory_bytes(n_weights: Ints, bits: Ints) -> Floats:
    """Return the memory of the stored weights, W_t times their bits / 8.

    Args:
        n_weights: (...,) stored weights W_t, those that are exactly 0 left out.
        bits: (...,) bits of each.
    """
    return np.asarray(n_weights * bits / 8)
