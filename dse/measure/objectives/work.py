"""What an answer takes, before any chip: time on the sensor's clock, weights, spikes and operations.

    S = (1 / N) sum over samples n, neurons i of s_i,n           spikes per inference, Eq. (3)
    rate = mean spikes per inference / (neurons x mean time of the decision)

The source prints values of S that exceed what one inference can hold, fall by 98.6 % between nets of equal
input, and fit the sum over its test set without the input layer: `spikes_total_no_input`. A study without a
test set does not have it. The other spikes are those of the validation set.

Copies of a shared weight count once in W_t. Only pruning leaves weights at exactly 0: W_t of a network that
was not pruned is the source's. `n_weights_dense` is what a family that prunes reports of its training,
`n_synapses` what one that shares weights does.

Synaptic operations are effective accumulates in the sense of NeuroBench for binary inputs: weights that
pruning removed do not count, those that 8 bits round to 0 do. Output spikes have no targets. Of a classifier
that is no stack of spiking layers, they are its additions.

Sources: Brayshaw et al., texture and velocity, Eq. (3), W_t = sum over layers of i_l i_(l+1); Rasouli et al.,
an extreme learning machine for texture recognition, Fig. 15: the input spike rate, mean over the receptors
(REFERENCES.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dse.base.records import Array, Floats, Ints
from dse.base.registry import Column, register
from dse.measure.objectives import Points


@register("objectives", "work")
@dataclass(frozen=True)
class Work:
    """Time of the decision, stored weights, and mean work per inference."""

    needs = "points"
    columns = (
        Column(
            "n_weights",
            "",
            "min",
            "Number W_t of nonzero weights, with recurrent weights and those of delayed inputs; shared ones "
            "count once.",
            of_design=True,
            known="exact",
        ),
        Column("n_weights_dense", "", "min", "Number of weights, pruned weights included.", of_design=True),
        Column(
            "n_synapses",
            "",
            "min",
            "Number of synapses, of which several share a weight; chips hold and price each.",
            of_design=True,
        ),
        Column(
            "memory_bytes",
            "bytes",
            "min",
            "Memory of the weights: W_t times the bits per weight (and per delay of a synapse where synapses "
            "have one) / 8; indices and neuron states are not counted.",
            of_design=True,
            known="exact",
        ),
        Column(
            "decision_latency_ms",
            "ms",
            "min",
            "Mean time from the first touch to the decision, by the clock of the sensor.",
            known="bound",
        ),
        Column("undecided", "", "min", "Fraction of samples that never reach the confidence theta."),
        Column("ties", "", "min", "Fraction of samples that are decided between classes of equal spikes."),
        Column("spikes_per_inference", "", "min", "Mean spikes per inference, all layers (S of Eq. 3)."),
        Column(
            "spikes_per_inference_no_input", "", "min", "Mean spikes per inference, without the input layer."
        ),
        Column(
            "spikes_total", "", "min", "Spikes of all layers, summed over all samples of the validation set."
        ),
        Column(
            "spikes_total_no_input",
            "",
            "min",
            "Spikes of hidden and output layers, summed over the test set (S as published).",
            of_test=True,
        ),
        Column(
            "synaptic_operations",
            "",
            "min",
            "Mean synaptic operations per inference: each spike counts once per target neuron.",
        ),
        Column(
            "macs",
            "",
            "min",
            "Mean multiply-accumulates per inference; a spiking network only adds, so it has none.",
        ),
        Column("input_spike_rate_hz", "Hz", "min", "Mean spike rate of an input channel."),
        Column("spike_rate_hz", "Hz", "min", "Mean spike rate of a hidden or output neuron."),
    )

    def measure(self, points: Points) -> Mapping[str, Array]:
        seconds, all_layers = points.decision_latency_ms * 1e-3, points.spikes.sum(axis=-1)
        no_input = points.spikes[..., 1:].sum(axis=-1)
        columns: dict[str, Array] = {
            "n_weights": points.n_weights,
            "memory_bytes": memory_bytes(points.n_weights, np.array(points.load.number_bits)),
            "decision_latency_ms": points.decision_latency_ms,
            "spikes_per_inference": all_layers,
            "spikes_per_inference_no_input": no_input,
            "spikes_total": np.asarray(np.rint(all_layers * points.n_samples).astype(np.int64)),
            "synaptic_operations": points.load.synaptic_operations,
            "macs": points.load.macs,
        }
        if points.decisions is not None:
            columns |= {"undecided": points.decisions.undecided, "ties": points.decisions.ties}
        if points.spikes_test is not None:
            columns["spikes_total_no_input"] = points.spikes_test
        if points.n_inputs is not None:
            columns["input_spike_rate_hz"] = points.spikes[..., 0] / points.n_inputs / seconds
        if points.n_neurons is not None:
            columns["spike_rate_hz"] = no_input / points.n_neurons / seconds
        return columns


def memory_bytes(n_weights: Ints, bits: Ints) -> Floats:
    """Return the memory of the stored weights, W_t times their bits / 8.

    Args:
        n_weights: (...,) stored weights W_t, those that are exactly 0 left out.
        bits: (...,) bits of each.
    """
    return np.asarray(n_weights * bits / 8)
