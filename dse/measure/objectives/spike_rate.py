"""Spike rates in Hz: what the sensor sends, and what the network adds.

    rate = mean spikes per inference / (neurons x mean time of the decision)

Source: Rasouli et al., an extreme learning machine for texture recognition, Fig. 15 (REFERENCES.md): the
input spike rate, mean over the receptors.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from dse.measure.objectives import Points
from dse.records import Floats
from dse.registry import Column, register


@register("objectives", "spike_rate")
@dataclass(frozen=True)
class SpikeRate:
    """Mean spike rate of an input channel, and of a hidden or output neuron."""

    needs = "points"
    columns = (
        Column("input_spike_rate_hz", "Hz", "min", "Mean spike rate of an input channel."),
        Column("spike_rate_hz", "Hz", "min", "Mean spike rate of a hidden or output neuron."),
    )

    def measure(self, points: Points) -> Mapping[str, Floats]:
        seconds = points.decision_latency_ms * 1e-3
        columns = {}
        if points.n_inputs is not None:
            columns["input_spike_rate_hz"] = points.spikes[..., 0] / points.n_inputs / seconds
        if points.n_neurons is not None:
            columns["spike_rate_hz"] = points.spikes[..., 1:].sum(axis=-1) / points.n_neurons / seconds
        return columns
