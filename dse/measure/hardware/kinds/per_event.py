"""Chips of which little more is known than what an event costs.

    E = synaptic_event events + neuron_update N T + spike S        events = sum over layers l of s_l f_l
    t = tick T + synaptic_event_ns events

Counts per inference: T steps, N neurons (resonators count twice), S spikes of neurons, s_l spikes and f_l
targets per spike of layer l. `synaptic_event_pj` of some chips is all that a busy chip draws divided by its
events (`all_in`): neurons, spikes and static power are inside, near the activity that it was measured at. A
chip with little to do draws more per event: that is what the high end of its static power is for.

Where zeros are skipped, f_l counts the weights other than 0. Mapping onto cores of so many neurons, axons
(sources of spikes) and weights:

    1 core     all layers share it
    more       a core holds neurons of one layer, as many as it has room for with all their weights

On a crossbar of bits (IBM TrueNorth) a weight of b bits takes b axons of different types, as each neuron
holds a number per type: two's complement, so b is at most the number of types. A neuron sends to one axon, so
it has a copy for each of the b axons in each core that it goes to, and every copy gets all synaptic events.
Inputs come from outside and go to any axon. A neuron must see all its sources on one core: a wider layer
would have to be a sum of sums, which is another network.

Sources: those of the profiles; the rule for the crossbar is derived from what the chip is (REFERENCES.md).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from dse.base.records import Workload
from dse.base.registry import register
from dse.measure.hardware.plan import Misfit, Placement, Plan, largest, per_count
from dse.measure.hardware.profile import Figures, Number, Profile, claim, count, figure


@register("hardware.kinds", "per_event")
@dataclass(frozen=True)
class PerEvent(Profile):
    """Cores with published energies per event and little else."""

    delays_synapses = False

    synaptic_event_pj: Number = figure("pJ", "per synapse that a spike reaches")
    neuron_update_pj: Number = figure("pJ", "per neuron and step")
    spike_pj: Number = figure("pJ", "per spike of a neuron")
    all_in: Number = claim("1 if synaptic_event_pj includes all energy of a busy chip, else 0")
    static_mw: Number = figure("mW", "static power of the whole chip in addition, at any time")
    tick_us: Number = figure("us", "per step, independent of activity")
    synaptic_event_ns: Number = figure("ns", "per synapse that a spike reaches")
    skips_zero_weights: Number = claim(
        "1 if weights of 0 are neither stored nor cause synaptic events, else 0"
    )
    crossbar: Number = claim("1 if each bit of a weight takes an axon of a crossbar, else 0")
    inputs: Number = count("input channels")
    cores: Number = count("cores of the chip")
    neurons_per_core: Number = count("neurons that a core holds")
    axons_per_core: Number = count("sources of spikes that a core listens to")
    synapses_per_core: Number = count("weights that a core holds")
    weight_bits: Number = count("bits per weight; on a crossbar, types of axon")

    def plan_network(self, load: Workload, figures: Figures) -> Plan:
        """Return the plan of a spiking network (`Profile.plan`)."""
        mapping = self._mapping(load)
        # Copies of a neuron get every spike that it gets; a weight of b bits has b bits of the crossbar.
        onward = [n * copies for n, copies in zip(load.sizes[1:], mapping.copies, strict=True)]
        recurrent = [n if back else 0 for n, back in zip(onward, load.recurrent, strict=True)]
        copied = np.add((*onward, 0), (0, *recurrent)) * mapping.axons_per_source
        reached = (load.synapses if self.skips_zero_weights.value else None) or load.fan_out
        shares = [few / most if most else 1.0 for few, most in zip(reached, load.fan_out, strict=True)]
        events = per_count(load, spike=[n * share for n, share in zip(copied, shares, strict=True)])
        neurons = per_count(
            load, step=sum(n * work for n, work in zip(onward, load.update_work, strict=True))
        )
        energy = {
            "synaptic_event": np.multiply.outer(figures["synaptic_event_pj"], events),
            "neuron_update": np.multiply.outer(figures["neuron_update_pj"], neurons),
            "spike": np.multiply.outer(figures["spike_pj"], per_count(load, spike=(0.0, *mapping.copies))),
        }
        time_ns = np.multiply.outer(figures["tick_us"], per_count(load, step=1e3))
        time_ns += np.multiply.outer(figures["synaptic_event_ns"], events)
        chips = -(-sum(mapping.cores) // int(self.cores.value))
        static_mw = figures["static_mw"] * chips
        placement = Placement(
            mapping.cores, self._misfits(load, mapping), assumptions=self._assumptions(load, mapping)
        )
        return Plan(energy, time_ns[..., None, :], static_mw, static_mw, placement)

    def _stored(self, load: Workload) -> tuple[int, ...]:
        """Return the weights that take memory in each layer after the input."""
        return load.stored if load.stored is not None and self.skips_zero_weights.value else load.dense

    def _mapping(self, load: Workload) -> _Mapping:
        """Return where a network goes; one that does not fit, as if cores held what they do not."""
        n_layers = len(load.sizes) - 1
        axons_per_source = min(load.weight_bits, int(self.weight_bits.value)) if self.crossbar.value else 1
        if self.cores.value == 1:
            # One that does not fit is cut into as many chips as its neurons or its weights need.
            needed = max(
                sum(load.sizes[1:]) / self.neurons_per_core.value,
                sum(self._stored(load)) / self.synapses_per_core.value,
            )
            return _Mapping((max(1, math.ceil(needed)),), (1,) * n_layers, axons_per_source)
        cores: list[int] = []
        copies: list[int] = []
        after = 0  # cores of the next layer: a layer's copies depend on them, so the last comes first
        for layer in range(n_layers, 0, -1):
            n, loops = load.sizes[layer], load.recurrent[layer - 1]
            per_neuron = max(1.0, self._stored(load)[layer - 1] / n)
            held = max(1, int(min(self.neurons_per_core.value, self.synapses_per_core.value / per_neuron)))
            n_cores, n_copies = _copied(n, held, after, loops, axons_per_source if self.crossbar.value else 0)
            cores.append(n_cores)
            copies.append(n_copies)
            after = n_cores
        return _Mapping(tuple(reversed(cores)), tuple(reversed(copies)), axons_per_source)

    def _misfits(self, load: Workload, mapping: _Mapping) -> tuple[Misfit, ...]:
        misfits = []
        most_bits = int(self.weight_bits.value)
        if load.weight_bits > most_bits:
            text = f"weights of {load.weight_bits} bits, {most_bits} at most"
            misfits.append(Misfit("weight_bits", text, f"weights of {most_bits} bits"))
        if load.delay_bits:
            text = f"{load.delay_bits} bits of delay per synapse; none are known to be supported"
            misfits.append(Misfit("delays", text, "synapses without individual delays"))
        if load.step_ms * 1e3 < self.tick_us.value:
            least_ms = self.tick_us.value * 1e-3
            text = f"steps of {load.step_ms:g} ms, a step takes {least_ms:g} ms"
            misfits.append(Misfit("tick_us", text, f"steps of {least_ms:g} ms"))
        misfits += self.exceeded([("inputs", load.sizes[0], "inputs")])
        if self.cores.value > 1:
            return (*misfits, *self._misfits_of_layers(load, mapping))
        sources = sum(n for n, targets in zip(load.sizes, load.fan_out, strict=True) if targets)
        needs = (
            ("neurons_per_core", sum(load.sizes[1:]), "neurons"),
            ("axons_per_core", sources, "inputs and neurons that send to neurons"),
            ("synapses_per_core", sum(self._stored(load)), "weights"),
        )
        return (*misfits, *self.exceeded(needs, " in all"))

    def _misfits_of_layers(self, load: Workload, mapping: _Mapping) -> list[Misfit]:
        misfits = []
        most = int(self.axons_per_core.value)
        for layer, (n, loops) in enumerate(zip(load.sizes[1:], load.recurrent, strict=True), start=1):
            sources = load.sizes[layer - 1] + (n if loops else 0)
            axons = sources * mapping.axons_per_source
            if axons > most:
                text = f"layer {layer}: {axons} axons for {sources} sources, {most} per core"
                change = f"{most // mapping.axons_per_source} sources to layer {layer}"
                if self.crossbar.value and sources <= most:
                    change += f", or weights of {most // sources} bits"
                misfits.append(Misfit("axons_per_core", text, change))
            weights = math.ceil(self._stored(load)[layer - 1] / n)
            if weights > self.synapses_per_core.value:
                most_weights = int(self.synapses_per_core.value)
                text = f"layer {layer}: {weights} weights of one neuron, {most_weights} per core"
                misfits.append(Misfit("synapses_per_core", text, f"{most_weights} weights per neuron"))
        needed, limit = sum(mapping.cores), int(self.cores.value)
        if needed > limit:
            change = self._smaller(load) or f"{-(-needed // limit)} chips"
            misfits.append(Misfit("cores", f"{needed} cores; the chip has {limit}", change))
        return misfits

    def _smaller(self, load: Workload) -> str | None:
        """Return which hidden layer fits the cores by losing the fewest neurons; None: none can."""
        shares = [few / all_of for few, all_of in zip(self._stored(load), load.dense, strict=True)]
        found = []
        for layer in range(1, len(load.sizes) - 1):

            def fits(n: int, layer: int = layer) -> bool:
                sizes = (*load.sizes[:layer], n, *load.sizes[layer + 1 :])
                dense = replace(load, sizes=sizes, stored=None, synapses=None)
                stored = tuple(math.ceil(k * n) for k, n in zip(shares, dense.dense, strict=True))
                return sum(self._mapping(replace(dense, stored=stored)).cores) <= self.cores.value

            n = largest(0, load.sizes[layer], fits)
            found += [(load.sizes[layer] - n, layer, n)] if n else []
        return f"{min(found)[2]} neurons in layer {min(found)[1]}" if found else None

    def _assumptions(self, load: Workload, mapping: _Mapping) -> tuple[str, ...]:
        assumptions = []
        if self.all_in.value:
            assumptions.append(
                "the energy per synaptic event includes all costs and holds near the activity at which it "
                "was measured; at lower activity up to the static power of the chip comes on top"
            )
        elif self.static_mw.value == 0:
            assumptions.append(
                "static power is unknown and omitted; its high end is the power of a whole chip"
            )
        if self.crossbar.value:
            assumptions.append(
                f"{mapping.axons_per_source} axons per source for the bits of a weight, and a copy of a "
                f"neuron for every axon that it serves: {', '.join(map(str, mapping.copies))} per layer"
            )
        return tuple(assumptions)


@dataclass(frozen=True)
class _Mapping:
    """Where a network goes: cores (one entry for a shared core) and copies of a neuron, layer by layer."""

    cores: tuple[int, ...]
    copies: tuple[int, ...]
    axons_per_source: int


def _copied(n: int, held: int, after: int, recurrent: bool, axons_per_source: int) -> tuple[int, int]:
    """Return the cores of a layer of n neurons and the copies of each, of which a core holds some.

    A neuron has a copy for every axon that it serves, on the cores after it and, if recurrent, its own; it
    serves none (0) where one message is for all.
    """
    # More axons for one's own layer than a core holds neurons have no solution, and too many axons anyway.
    own_copies = axons_per_source if recurrent and n * axons_per_source < held else 0
    n_cores = 1
    while True:
        copies = max(1, axons_per_source * after + own_copies * n_cores)
        needed = -(-n * copies // held)
        if needed <= n_cores:
            return n_cores, copies
        n_cores = needed
