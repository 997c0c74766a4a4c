"""Synaptic operations: what a spike costs in additions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from dse.measure.objectives import Points
from dse.records import Floats
from dse.registry import Column, register


@register("objectives", "synaptic_operations")
@dataclass(frozen=True)
class SynapticOperations:
    """Mean synaptic operations per inference: each spike counts once per target neuron.

    Effective accumulates in the sense of NeuroBench for binary inputs: weights that pruning removed do not
    count, those that 8 bits round to 0 do. Output spikes have no targets. Of a classifier that is no stack of
    spiking layers, its additions.
    """

    needs = "points"
    columns = (
        Column(
            "synaptic_operations",
            "",
            "min",
            "Mean synaptic operations per inference: each spike counts once per target neuron.",
        ),
    )

    def measure(self, points: Points) -> Mapping[str, Floats]:
        return {"synaptic_operations": points.load.synaptic_operations}
