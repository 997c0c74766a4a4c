"""Parameters of stored layers, as tests write them."""

from __future__ import annotations

from dse.neurons import cuba_lif, parameters_of
from dse.records import Array


def cuba_parameters(decay_current: Array, decay_voltage: Array, threshold: int) -> dict[str, Array]:
    """Return the parameters of a layer of CUBA-LIF neurons."""
    return parameters_of(cuba_lif.Population(decay_current, decay_voltage, threshold))
