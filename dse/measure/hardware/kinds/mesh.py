"""Asynchronous cores on a mesh that pass spikes as messages: Intel Loihi's kind, in closed form.

Dynamic energy, from counts per inference (T steps; layers 1.. are neurons, layer 0 the input):

    E = access N T + update U + spike S + event sum_l s_l f_l + message M + hops

N neurons, U updates (those of resonators count twice), S spikes of neurons, s_l spikes and f_l targets per
spike of layer l, and M messages: one per spike and destination core. On a chip that skips zero weights, f_l
counts the weights that pruning left (`Workload.synapses`); where only all weights fit, not lists of these,
all are stored, and are events. Time of a step, from counts per step:

    t = barrier(tiles) + max over cores of max(send, receive)
    send    = access n + update u + spike s + message_out m        what the core's own n neurons do
    receive = sum over messages received of (message_in + event n)          n: targets in the core

The answer of the last step leaves the last layer `steps_per_layer` steps per layer later.

Mean field of a pruned network: every spike of a layer reaches the same share of each core's neurons,
and every neuron still gets every message.

What it leaves out: from mean counts, the maximum of means is below the mean of maxima (up to 6 % on
reference runs whose activity fluctuates); queues in the network count in the high end only; spreading a
layer over more cores than hold it, as compilers do, sends more messages.

Source: SANA-FE (REFERENCES.md), whose energy and `simple` time it reproduces from the same counts.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dse.base.records import Floats, Ints, Workload, sum_of_products
from dse.base.registry import register
from dse.measure.hardware.placement import Architecture, Rules, architecture, hops, place
from dse.measure.hardware.plan import Congestion, Plan
from dse.measure.hardware.profile import Figures, Number, Profile, claim, count, figure

_EVENTS = ("neuron_access", "neuron_update", "spike", "synaptic_event", "message", "hop_x", "hop_y")
_BUSY = ("neuron_access", "neuron_update", "spike", "synaptic_event", "message_out", "message_in")


@dataclass(frozen=True)
class _Work:
    """How often a network on its cores pays each figure, per count of an inference (F, see `features`).

    events: (event, F), by _EVENTS.
    busy: (event, K, F), by _BUSY, of what can be the slowest.
    destinations: (layer,), cores that a spike goes to, input first.
    """

    events: Floats
    busy: Floats
    destinations: Ints


@register("hardware.kinds", "mesh")
@dataclass(frozen=True)
class Mesh(Profile):
    """Asynchronous cores on a mesh, with a barrier at every step: Intel Loihi's kind."""

    neuron_access_pj: Number = figure("pJ", "per mapped neuron and step")
    neuron_update_pj: Number = figure("pJ", "per step and neuron whose state changes")
    spike_pj: Number = figure("pJ", "per spike of a neuron")
    synaptic_event_pj: Number = figure("pJ", "per synapse that a spike reaches")
    message_pj: Number = figure("pJ", "per spike and core that receives it")
    hop_x_pj: Number = figure("pJ", "a message from a tile to the next along x")
    hop_y_pj: Number = figure("pJ", "a message from a tile to the next along y")
    neuron_access_ns: Number = figure("ns", "as neuron_access_pj")
    neuron_update_ns: Number = figure("ns", "as neuron_update_pj")
    spike_ns: Number = figure("ns", "as spike_pj")
    synaptic_event_ns: Number = figure("ns", "as synaptic_event_pj")
    message_out_ns: Number = figure("ns", "sending a message")
    message_in_ns: Number = figure("ns", "receiving a message")
    barrier_1_us: Number = figure("us", "time of the synchronisation of a step, 1 tile in use")
    barrier_2_us: Number = figure("us", "the same from 2 tiles on")
    barrier_4_us: Number = figure("us", "the same from 4 tiles on")
    barrier_29_us: Number = figure("us", "the same from 29 tiles on")
    congestion_factor: Number = figure("1", "factor on the time of a step if the network is congested")
    congestion_spikes: Number = figure(
        "1", "the network is congested above this many spikes of a layer per step"
    )
    congestion_cores: Number = figure("1", "and if they are sent to at least this many cores")
    static_mw: Number = figure("mW", "static power of the whole chip")
    steps_per_layer: Number = count("steps that a spike takes to reach the next layer")
    cores: Number = count("cores of the chip")
    cores_per_tile: Number = count("cores that share a router")
    mesh_height: Number = count("tiles along y")
    neurons_per_core: Number = count("neurons that a core holds")
    synapse_memory_bits: Number = count("bits for synapses in a core")
    input_axons_per_core: Number = count("sources of spikes that a core listens to")
    output_axons_per_core: Number = count("output axons of a core: pairs of neuron and destination core")
    synapse_block: Number = count("targets of an axon in a core that are stored in one block")
    synapse_header_bits: Number = figure("1", "bits of a block in addition to its synapses; without a range")
    synapse_word_bits: Number = count("bits to a multiple of which a block is rounded up")
    synapse_index_bits: Number = count("bits of the index of a target if weights of 0 are not stored")
    weight_bits_any: Number = count("weights can be stored with any number of bits up to this")
    weight_bits_most: Number = count("and with this number of bits, the largest")
    delay_bits_most: Number = count("bits of a synapse's own delay")
    practice_weights_per_core: Number = figure(
        "1", "8-bit weights per core that a compiler reaches in practice; 0: as many as fit"
    )
    skips_zero_weights: Number = claim(
        "1 if weights of 0 are neither stored nor cause synaptic events, else 0"
    )
    state_bits: Number | None = count("bits of a neuron's states, their sign included", optional=True)

    @functools.cached_property
    def rules(self) -> Rules:
        """What a core and the chip hold."""
        practice = self.practice_weights_per_core
        known = Rules.__annotations__
        numbers: Any = {name: int(x) for name, x in self.at("value").items() if name in known}
        return Rules(**numbers, practice=(practice.low, practice.high) if practice.low > 0 else None)

    def plan_network(self, load: Workload, figures: Figures) -> Plan:
        """Return the plan of a spiking network (`Profile.plan`)."""
        rules = self.rules
        net, synapses = architecture(load, rules), load.synapses if rules.skips_zero_weights else None
        placement = place(net, rules)
        if net.stored is not None and placement.misfits:
            dense = place(replace(net, stored=None), rules)
            if not dense.misfits:
                note = (
                    "weights of 0 are stored and read like others, because lists of the remaining weights "
                    "do not fit"
                )
                placement, synapses = replace(dense, assumptions=(*dense.assumptions, note)), None
        work = _work(net, placement.cores, synapses, load.update_work, rules)
        energy_pj = {
            event: figures[f"{event}_pj"][..., None] * per_count
            for event, per_count in zip(_EVENTS, work.events, strict=True)
        }
        energy_pj["hop"] = energy_pj.pop("hop_x") + energy_pj.pop("hop_y")
        ns = np.array([figures[f"{event}_ns"] for event in _BUSY]).T
        time_ns = sum_of_products(ns[..., None, None, :], np.moveaxis(work.busy, 0, -1))
        time_ns[..., 0] += self._barrier_ns(placement.n_cores, figures)[..., None]
        chips = -(-max(placement.n_cores, placement.low or 0) // rules.cores)
        static_mw = figures["static_mw"] * chips
        if load.n_resonators:
            note = "an update of a resonator counts twice: four multiplications where others have two"
            placement = replace(placement, assumptions=(*placement.assumptions, note))
        return Plan(
            energy_pj=energy_pj,
            time_ns=time_ns,
            static_mw=static_mw,
            idle_mw=static_mw,
            placement=placement,
            congestion=Congestion(
                work.destinations >= self.congestion_cores.value,
                self.congestion_spikes.value,
                figures["congestion_factor"],
            ),
            share=placement.n_cores / (chips * rules.cores),
        )

    def pipeline_steps(self, load: Workload) -> int:
        """Return the steps that an answer takes through the layers (`Profile.pipeline_steps`)."""
        return int(self.steps_per_layer.value) * len(load.recurrent)

    def _barrier_ns(self, n_cores: int, figures: Figures) -> Floats:
        tiles = -(-n_cores // self.rules.cores_per_tile)
        return np.asarray(figures[f"barrier_{max(n for n in (1, 2, 4, 29) if n <= tiles)}_us"] * 1e3)


@functools.lru_cache(maxsize=1 << 12)
def _work(
    net: Architecture,
    cores: tuple[int, ...],
    synapses: tuple[float, ...] | None,
    update_work: tuple[float, ...],
    rules: Rules,
) -> _Work:
    """Return the work of a network on so many cores of each layer.

    Of each layer, input first, a spike reaches so many synapses; None: all.
    """
    sizes, recurrent, n_layers = net.sizes, net.recurrent, len(net.sizes)

    def onward(of_layers: Sequence[int]) -> list[int]:
        """Return how many of the next layer's and, where it is recurrent, its own each layer sends to."""
        within = (n * loops for n, loops in zip(of_layers, recurrent, strict=True))
        return [a + b for a, b in zip((*of_layers, 0), (0, *within), strict=True)]

    fan_out, destinations = onward(sizes[1:]), onward(cores)
    reached = fan_out if synapses is None else synapses
    shares = [a / b if b else 1.0 for a, b in zip(reached, fan_out, strict=True)]
    # Counts: steps, spikes of each layer, updates of each layer after the input.
    spikes, updates = slice(1, 1 + n_layers), slice(1 + n_layers, 2 * n_layers)
    events = np.zeros((len(_EVENTS), 2 * n_layers))
    access, update, spike, event, message, hop_x, hop_y = events
    access[0] = sum(sizes[1:])
    update[updates] = update_work
    spike[2 : 1 + n_layers] = 1
    event[spikes] = reached
    message[spikes] = destinations
    hop_x[spikes], hop_y[spikes] = zip(*hops(net, cores, rules), strict=True)

    busy = np.zeros((len(_BUSY), 2 * n_layers - 1, 2 * n_layers))
    access, update, spike, event, message_out, message_in = busy
    # Inputs are sent by sources of as many channels as a core has neurons.
    message_out[0, 1] = destinations[0] / -(-sizes[0] // rules.neurons_per_core)
    for layer in range(1, n_layers):
        neurons = -(-sizes[layer] // cores[layer - 1])
        send, receive, share = 2 * layer - 1, 2 * layer, neurons / sizes[layer]
        access[send, 0] = neurons
        update[send, n_layers + layer] = share * update_work[layer - 1]
        spike[send, 1 + layer] = share
        message_out[send, 1 + layer] = destinations[layer] * share
        for source in (layer - 1, layer)[: 1 + recurrent[layer - 1]]:
            message_in[receive, 1 + source] = 1
            event[receive, 1 + source] = neurons * shares[source]
    return _Work(events, busy, np.array(destinations))
