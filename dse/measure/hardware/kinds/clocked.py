"""A core that works through its neurons and spikes one after the other at a clock: SynSense Xylo's kind.

Cycles, from counts per inference (T steps; I inputs, N hidden neurons in all, H of them in the last hidden
layer, O outputs; s_0 input spikes, s_l spikes of hidden layer l):

    cycles = T (input_channel I + neuron N + output_neuron O) + input_synapse s_0 n_1
             + sum over hidden layers l of s_l (spike + hidden_synapse f_l)
             + s_H (output_spike + output_synapse O)

n_1 neurons have input weights: the first layer; f_l hidden neurons get a spike of layer l: those of the next
hidden layer, and its own where it is recurrent. With one hidden layer, p = s / (neurons x steps) and the
vendor's numbers this is its model:

    I (1 + 3.5 p_I N) + N (22 + 3 p_H) + N p_H (1 + 8 O) + 12 O + 7 f N p_H       cycles per step

Energy: power above idle times computing time is dynamic; power that flows in any case is static, of core and
IO while computing, of core and waiting IO between steps. The clock must be fast enough for a step in which
everything spikes, with a margin.

Weights of 0 cost no cycles between hidden neurons; from inputs and to outputs they cost as much as others.

Source: Rockpool's cycle model of this chip (REFERENCES.md), without aliases.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dse.base.records import Floats, Workload, sum_of_products
from dse.base.registry import register
from dse.measure.hardware.plan import Misfit, Placement, Plan, of_cycles
from dse.measure.hardware.profile import Figures, Number, Profile, count, figure


@register("hardware.kinds", "clocked")
@dataclass(frozen=True)
class Clocked(Profile):
    """One clocked core with hidden and output neurons: SynSense Xylo's kind."""

    delays_synapses = False

    input_channel_cycles: Number = figure("1", "cycles per input and step")
    input_synapse_cycles: Number = figure("1", "cycles per input spike and neuron with input weights")
    neuron_cycles: Number = figure("1", "cycles per hidden neuron and step")
    spike_cycles: Number = figure("1", "cycles per spike of a hidden neuron")
    hidden_synapse_cycles: Number = figure("1", "cycles per hidden neuron that such a spike reaches")
    output_spike_cycles: Number = figure("1", "cycles per spike sent to the outputs")
    output_synapse_cycles: Number = figure("1", "cycles per output that such a spike reaches")
    output_neuron_cycles: Number = figure("1", "cycles per output and step")
    computing_uw: Number = figure("uW", "power while computing, on top of the other powers")
    core_idle_uw: Number = figure("uW", "power of the core at any time")
    io_uw: Number = figure("uW", "power of input and output pins while computing")
    io_waiting_uw: Number = figure("uW", "power of input and output pins while waiting for the next step")
    clock_mhz: Number = figure("MHz", "clock frequency at which the cycle counts hold", whole=True)
    maximum_clock_mhz: Number = figure("MHz", "highest clock frequency", whole=True)
    clock_margin: Number = figure("1", "factor on the cycles of a step in which every neuron spikes")
    inputs: Number = count("input channels")
    hidden_neurons: Number = count("neurons between inputs and outputs")
    outputs: Number = count("output neurons")
    neurons_with_input: Number = count("hidden neurons that can receive inputs")
    neurons_with_output: Number = count("hidden neurons that can connect to outputs")
    fan_out: Number = count("hidden neurons that one hidden neuron can connect to")
    hidden_weights: Number = count("weights between hidden neurons")
    weight_bits: Number = count("bits per weight")

    def plan_network(self, load: Workload, figures: Figures) -> Plan:
        """Return the plan of a spiking network (`Profile.plan`)."""
        clock_mhz = self.clock_mhz.value
        return of_cycles(
            _cycles(load, figures),
            figures["computing_uw"] * 1e-3 * (1e3 / clock_mhz),
            clock_mhz,
            static_mw=(figures["core_idle_uw"] + figures["io_uw"]) * 1e-3,
            idle_mw=(figures["core_idle_uw"] + figures["io_waiting_uw"]) * 1e-3,
            placement=self._placement(load),
        )

    def worst_clock_mhz(self, load: Workload) -> float:
        """Return the clock at which a step in which everything spikes is done in time, with the margin."""
        per_count = np.sum(list(_cycles(load, self.ends).values()), axis=0)[0]
        n_layers = len(load.sizes)
        cycles = per_count[0] + sum_of_products(per_count[1 : 1 + n_layers], np.array(load.sizes))
        return float(cycles) * self.clock_margin.value / (load.step_ms * 1e3)

    def _placement(self, load: Workload) -> Placement:
        needed_mhz, most_mhz = self.worst_clock_mhz(load), self.maximum_clock_mhz.value
        misfits = self._broken_limits(load)
        if needed_mhz > most_mhz:
            # In microseconds, rounded up so that the change is enough.
            least_ms = math.ceil(load.step_ms * needed_mhz / most_mhz * 1e3) / 1e3
            text = f"a clock of {needed_mhz:.1f} MHz for steps of {load.step_ms:g} ms, at most {most_mhz:.0f}"
            misfits.append(Misfit("maximum_clock_mhz", text, f"steps of {least_ms:.3f} ms"))
        assumption = (
            f"clock of {self.clock_mhz.value:.0f} MHz; "
            f"{needed_mhz:.1f} MHz suffice even if every neuron spikes"
        )
        return Placement((1,), tuple(misfits), assumptions=(assumption,))

    def _broken_limits(self, load: Workload) -> list[Misfit]:
        """Return the limits that the network breaks, whatever the clock."""
        hidden, misfits = load.sizes[1:-1], []
        if not hidden:
            text = "it has no hidden layer, and inputs cannot connect to outputs"
            misfits.append(Misfit("layers", text, "a hidden layer"))
        needs = (
            ("inputs", load.sizes[0], "inputs"),
            ("hidden_neurons", sum(hidden), "hidden neurons"),
            ("outputs", load.sizes[-1], "outputs"),
            ("neurons_with_input", hidden[0] if hidden else 0, "neurons in the first layer"),
            ("neurons_with_output", hidden[-1] if hidden else 0, "neurons in the last hidden layer"),
            ("fan_out", math.ceil(max(_hidden_targets(load), default=0)), "hidden neurons per spike"),
            ("hidden_weights", math.ceil(_hidden_weights(load)), "weights between hidden neurons"),
            ("weight_bits", load.weight_bits, "bits per weight"),
        )
        misfits += self.exceeded(needs)
        if load.recurrent[-1]:
            text = "its outputs are recurrent, and only hidden neurons can be"
            misfits.append(Misfit("recurrent_outputs", text, "an output layer without recurrence"))
        if load.delay_bits:
            text = f"{load.delay_bits} bits of delay per synapse; the chip supports none"
            misfits.append(Misfit("delays", text, "synapses without individual delays"))
        return misfits


def _cycles(load: Workload, figures: Figures) -> dict[str, Floats]:
    """Return the cycles per count by cause, (D..., F)."""
    sizes, n_layers = load.sizes, len(load.sizes)
    shape = figures["neuron_cycles"].shape
    rows = {
        cause: np.zeros((*shape, 2 * n_layers)) for cause in ("input", "neuron", "spike", "synapse", "output")
    }
    rows["input"][..., 0] = figures["input_channel_cycles"] * sizes[0]
    rows["input"][..., 1] = figures["input_synapse_cycles"] * sizes[1]
    rows["neuron"][..., 0] = figures["neuron_cycles"] * sum(sizes[1:-1])
    rows["output"][..., 0] = figures["output_neuron_cycles"] * sizes[-1]
    for layer, reached in enumerate(_hidden_targets(load), start=1):
        rows["spike"][..., 1 + layer] = figures["spike_cycles"]
        rows["synapse"][..., 1 + layer] = figures["hidden_synapse_cycles"] * reached
    if n_layers > 2:
        rows["output"][..., n_layers - 1] = (
            figures["output_spike_cycles"] + figures["output_synapse_cycles"] * sizes[-1]
        )
    return rows


def _hidden_targets(load: Workload) -> list[float]:
    """Return how many hidden neurons a spike of each hidden layer reaches in the mean."""
    n_hidden = len(load.sizes) - 2
    reached = []
    for layer in range(1, n_hidden + 1):
        onward = load.sizes[layer + 1] if layer < n_hidden else 0
        recurrent = load.sizes[layer] if load.recurrent[layer - 1] else 0
        share = 1.0 if load.synapses is None else load.synapses[layer] / load.fan_out[layer]
        reached.append(share * (onward + recurrent))
    return reached


def _hidden_weights(load: Workload) -> float:
    """Return the weights between hidden neurons that are not 0, if zeros are spread evenly over a layer's."""
    total = 0.0
    for layer in range(1, len(load.sizes) - 1):
        before = load.sizes[layer - 1] if layer > 1 else 0
        recurrent = load.sizes[layer] if load.recurrent[layer - 1] else 0
        stored = (load.stored or load.dense)[layer - 1]
        total += load.sizes[layer] * (before + recurrent) * stored / load.dense[layer - 1]
    return total
