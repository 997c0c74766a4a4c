"""A microcontroller that runs the classifier as a program: cycles, times the energy of a cycle.

    energy = cycles x cycle_nj              time = cycles / clock

    cycles of a spiking network   instruction_cycles x instructions, which are the sum of
                                      step_instructions x steps
                                      neuron_instructions x neurons x steps
                                      update_instructions x updates; of resonators
                                          resonator_instructions, of outputs output_instructions
                                      spike_instructions x spikes x layers that they reach
                                      synapse_instructions x weights that they meet; with delays of
                                          their own delayed_instructions
    cycles of anything else       mac_cycles x multiply-accumulates
                                      + instruction_cycles x synapse_instructions x additions
                                      + instruction_cycles x (neuron + update_instructions) x state updates

The program is the C of target `c99`, and the numbers of instructions are counts: it is compiled for the core
and executed in an emulator (`benchmarks.instructions` fits them and tests them on other networks). A spike
walks the weights of its targets and adds them up, one by one. Every neuron is looked at in every step, and
those that are not at rest are updated. Ranges are what differs between networks: decays that neurons share
take fewer instructions than those of their own, resonators beside neurons that decay more than without
them, and rows of few weights more than long ones. Encoder and preprocessing are left out, as elsewhere.

An instruction takes instruction_cycles. Its value is that of the emulated instructions by Arm's tables
without wait states (`dse.deploy.targets.emulator.Core`): one cycle each, one more per load unless the next
load or store hides it, and two per taken branch; a Cortex-M7 and a Cortex-M33 by their ratio of CoreMark per
MHz to a Cortex-M4. Low: every load is hidden, and branches refill the pipeline in one cycle. High: three
cycles per branch, and flash that makes weights wait where caches miss.

Multiply-accumulates of numbers of at most 8 bits are the measured integer kernels, those of longer ones
float.

Weights lie in flash as numbers of 8, 16, 32 or 64 bits: shorter ones are not unpacked on the way. Where lists
of the weights that are left, each with an index of 16 bits, are smaller than all weights, lists are stored,
and a weight takes list_instructions; else weights that are 0 take what others take. A delay per synapse takes
8 bits. States lie in working memory, 32 bits each: current and voltage, and with delays per synapse a current
per step of delay. The two factors of a resonator lie in flash, 16 bits each; those that other neurons share,
the program, its inputs and, of what is no spiking network, activations are not counted.

Between steps the processor sleeps, if it can: it takes sleep_uw, and running power for wake_us per step. What
is no spiking network sleeps until its input has arrived, so something else must gather it; its one wake-up is
left out. A step that takes longer than its period is slow, no misfit.

What is counted: `dse.hardware.kinds.operations`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dse.hardware.kinds.memory_hierarchy import (
    FACTOR_BITS,
    FACTORS,
    INDEX_BITS,
    STATE_BITS,
    as_lists,
    states_per_neuron,
)
from dse.hardware.plan import Misfit, Placement, Plan, per_count
from dse.hardware.profile import Figures, Number, Profile, figure
from dse.records import Floats, Operations, Workload
from dse.registry import register

_MOST_PACKED = 4
"""Bits of a weight up to which the C packs several into a word."""
_NO_PROGRAM = "the program and its other variables take no memory"


@register("hardware.kinds", "processor")
@dataclass(frozen=True)
class Processor(Profile):
    """A microcontroller with one core, which runs any classifier."""

    any_neuron = True

    cycle_nj: Number = figure("nJ", "energy of a cycle of the running processor, whole chip")
    mac_cycles: Number = figure("1", "cycles per 8-bit integer multiply-accumulate")
    float_mac_cycles: Number = figure("1", "cycles per floating-point multiply-accumulate")
    instruction_cycles: Number = figure("1", "cycles per instruction of the program")
    step_instructions: Number = figure("1", "instructions per network step")
    neuron_instructions: Number = figure("1", "instructions per neuron and step, at rest or not")
    update_instructions: Number = figure("1", "instructions per update of a neuron that is not at rest")
    output_instructions: Number = figure("1", "the same of an output neuron: outputs share their decays")
    resonator_instructions: Number = figure("1", "instructions per update of a resonator")
    spike_instructions: Number = figure("1", "instructions per spike and layer that it reaches")
    synapse_instructions: Number = figure("1", "instructions per weight that a spike meets, or addition")
    packed_instructions: Number = figure("1", "the same of weights of 4 bits or fewer, which are packed")
    list_instructions: Number = figure("1", "the same of weights that are stored as lists with indices")
    delayed_instructions: Number = figure("1", "the same of weights with delays of their own")
    sleep_uw: Number = figure("uW", "power of the sleeping processor with memory retained")
    wake_us: Number = figure("us", "time to wake up, at running power")
    clock_mhz: Number = figure("MHz", "clock", whole=True)
    flash_kib: Number = figure("KiB", "flash, for weights", whole=True)
    sram_kib: Number = figure("KiB", "working memory, for states", whole=True)

    def plan_network(self, load: Workload, figures: Figures) -> Plan:
        """Return the plan of a spiking network (`Profile.plan`); cores given by hand are ignored."""
        running_mw = figures["cycle_nj"] * self.clock_mhz.value
        waking_mw = running_mw * figures["wake_us"] * 1e-3 / load.step_ms
        return self._plan(figures, _of_network(load, figures), waking_mw, self._with_network(load))

    def plan_operations(self, load: Operations, figures: Figures) -> Plan:
        """Return the plan of any other classifier (`Profile.plan`)."""
        waking_mw = np.zeros_like(figures["cycle_nj"])
        return self._plan(figures, _of_operations(load, figures), waking_mw, self._with_numbers(load))

    @property
    def cycles_per_ms(self) -> float:
        """Cycles of a time of computing, such as `Cost.hardware_latency_ms`."""
        return self.clock_mhz.value * 1e3

    def _plan(
        self, figures: Figures, cycles: Mapping[str, Floats], waking_mw: Floats, placement: Placement
    ) -> Plan:
        total: Floats = np.sum(list(cycles.values()), axis=0)
        cycle_pj = figures["cycle_nj"] * 1e3
        clock_mhz = self.clock_mhz.value
        running_mw = figures["cycle_nj"] * clock_mhz
        return Plan(
            energy_pj={cause: cycle_pj[..., None] * per_count for cause, per_count in cycles.items()},
            time_ns=total[..., None, :] * (1e3 / clock_mhz),
            static_mw=np.zeros_like(running_mw),  # in the energy of a cycle
            idle_mw=np.minimum(figures["sleep_uw"] * 1e-3 + waking_mw, running_mw),
            placement=placement,
            running_mw=running_mw,
        )

    def _with_network(self, load: Workload) -> Placement:
        """Return the one core, and whether the memories hold the weights and the states."""
        lists = as_lists(load, _stored_bits(load))
        n_weights = sum(load.stored or ()) if lists else sum(load.dense)
        beside = _bytes(load.delay_bits) + (INDEX_BITS // 8 if lists else 0)
        factors = load.n_resonators * FACTORS * FACTOR_BITS // 8
        misfits = _flash_misfits(n_weights, load.weight_bits, beside, self._flash_bytes, factors)
        misfits += _sram_misfits(load, int(self.sram_kib.value) * 1024)
        return Placement((1,), misfits, assumptions=(_NO_PROGRAM, "the processor wakes once per step"))

    def _with_numbers(self, load: Operations) -> Placement:
        """Return the one core, and whether the flash holds the stored numbers."""
        n_weights = int(np.ceil(np.max(load.n_weights, initial=0)))
        misfits = _flash_misfits(n_weights, load.number_bits, 0, self._flash_bytes)
        sleeps = "the processor sleeps until all input has arrived"
        return Placement((1,), misfits, assumptions=(_NO_PROGRAM, sleeps))

    @property
    def _flash_bytes(self) -> int:
        return int(self.flash_kib.value) * 1024


def _of_network(load: Workload, figures: Figures) -> dict[str, Floats]:
    """Return the cycles per count by cause, (D..., F)."""
    cycles = figures["instruction_cycles"]
    lists = as_lists(load, _stored_bits(load))
    packed = load.weight_bits <= _MOST_PACKED
    form = "delayed" if load.delay_bits else "list" if lists else "packed" if packed else "synapse"
    synapse = figures[f"{form}_instructions"]
    reached = load.synapses if lists and load.synapses is not None else load.fan_out
    # Spikes of the outputs reach a layer only if it is recurrent.
    layers = [1.0, *(1.0 + back for back in load.recurrent)]
    layers[-1] -= 1.0
    n_neurons = sum(load.sizes[1:])
    resonating = np.array(load.update_work) - 1
    decaying = 1 - resonating
    output = np.arange(len(decaying)) == len(decaying) - 1
    updates = (
        ("update_instructions", np.where(output, 0.0, decaying).tolist()),
        ("output_instructions", np.where(output, decaying, 0.0).tolist()),
        ("resonator_instructions", resonating.tolist()),
    )
    return {
        "step": np.multiply.outer(cycles * figures["step_instructions"], per_count(load, step=1)),
        "synaptic_event": np.multiply.outer(cycles * synapse, per_count(load, spike=reached))
        + np.multiply.outer(cycles * figures["spike_instructions"], per_count(load, spike=layers)),
        "neuron_update": np.sum(
            [
                np.multiply.outer(cycles * figures["neuron_instructions"], per_count(load, step=n_neurons)),
                *(np.multiply.outer(cycles * figures[x], per_count(load, update=n)) for x, n in updates),
            ],
            axis=0,
        ),
    }


def _of_operations(load: Operations, figures: Figures) -> dict[str, Floats]:
    """Return the cycles per count by cause, (D..., 4)."""
    macs, additions, updates = np.eye(4)[1:]
    mac = figures["mac_cycles" if load.number_bits <= 8 else "float_mac_cycles"]
    cycles = figures["instruction_cycles"]
    update = figures["neuron_instructions"] + figures["update_instructions"]
    return {
        "mac": np.multiply.outer(mac, macs),
        "addition": np.multiply.outer(cycles * figures["synapse_instructions"], additions),
        "neuron_update": np.multiply.outer(cycles * update, updates),
    }


def _bytes(bits: int) -> int:
    """Return the bytes of the shortest type that holds so many bits: 1, 2, 4, 8; of no bits, none."""
    return 1 << (-(-bits // 8) - 1).bit_length() if bits else 0


def _stored_bits(load: Workload) -> int:
    """Return the bits that a weight takes in flash, its delay included."""
    return 8 * (_bytes(load.weight_bits) + _bytes(load.delay_bits))


def _flash_misfits(
    n_weights: int, bits: int, beside: int, flash: int, factors: int = 0
) -> tuple[Misfit, ...]:
    """Return the misfit of the weights, where there is one.

    Args:
        n_weights: numbers stored.
        bits: of each.
        beside: bytes that are stored with each.
        flash: bytes that there are.
        factors: bytes of the neurons' own factors.
    """
    size, flash = _bytes(bits) + beside, flash - factors
    if n_weights * size <= flash:
        return ()
    # The longest numbers that fit are the smallest change.
    types = (_bytes(bits) >> halved for halved in range(1, _bytes(bits).bit_length()))
    shorter = next((each for each in types if n_weights * (each + beside) <= flash), None)
    if shorter is None:
        change = f"at most {flash // size} weights instead of {n_weights}"
    else:
        change = f"weights of {8 * shorter} bits instead of {bits}"
    left = f" beside {factors} of neurons' factors" if factors else ""
    text = f"weights of {n_weights * size} bytes, {flash} bytes of flash{left}"
    return (Misfit("flash_kib", text, change),)


def _sram_misfits(load: Workload, sram: int) -> tuple[Misfit, ...]:
    """Return the misfit of the states, where there is one."""
    n_neurons = sum(load.sizes[1:])

    def needed(delay_bits: int) -> int:
        return n_neurons * states_per_neuron(delay_bits) * STATE_BITS // 8

    if needed(load.delay_bits) <= sram:
        return ()
    shorter = next((bits for bits in range(load.delay_bits - 1, -1, -1) if needed(bits) <= sram), None)
    if shorter is None:
        change = f"at most {sram * n_neurons // needed(load.delay_bits)} neurons instead of {n_neurons}"
    elif shorter == 0:
        change = "no individual delays of synapses"
    else:
        change = f"delays of {shorter} bits instead of {load.delay_bits}"
    text = f"states of {needed(load.delay_bits)} bytes, {sram} bytes of working memory"
    return (Misfit("sram_kib", text, change),)
