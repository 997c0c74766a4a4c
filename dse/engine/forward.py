"""Layers that run forward: by a kernel where their neurons have one, by their definition where not."""

from __future__ import annotations

from typing import Protocol

from dse.base.records import Arithmetic
from dse.engine import layers
from dse.engine.definition import DefinedLayer
from dse.engine.events import Rows
from dse.engine.layers import Forward, Weights

__all__ = ["Forward", "Prepared", "prepare"]


class Prepared(Protocol):
    """A layer that is laid out for many calls."""

    @property
    def n_neurons(self) -> int: ...

    def forward(self, rows: Rows, *, keep_voltage: bool = False, count: bool = False) -> Forward:
        """Run the layer from rest over a batch; arguments as in `dse.engine.layers.CompiledLayer.forward`."""
        ...


def prepare(weights: Weights, arithmetic: Arithmetic) -> Prepared:
    """Return a layer laid out for an arithmetic."""
    if layers.has_kernel(type(weights.population)):
        return layers.prepare(weights, arithmetic)
    return DefinedLayer(weights, arithmetic)
