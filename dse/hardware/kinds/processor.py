"""A microcontroller that runs the classifier as a program: cycles, times the energy of a cycle.

    energy = cycles x cycle_nj              time = cycles / clock

    cycles of a spiking network   event_cycles x synaptic events + update_macs x mac_cycles x updates
    cycles of anything else       mac_cycles x multiply-accumulates + event_cycles x additions
                                  + update_macs x mac_cycles x state updates

The program is driven by spikes: each walks the weights of its targets and adds them up, one by one. Every
neuron is updated in every step, as its state decays, and finding out that it need not be costs about as much.
A resonator has four multiplications where others have two, so its update counts twice.
Multiply-accumulates of numbers of at most 8 bits are the measured integer kernels, those of longer ones
float. Delivering a spike to the loop, and anything done once per step or per inference, is left to the range.

Weights lie in flash as numbers of 8, 16, 32 or 64 bits: shorter ones are not unpacked on the way. Where lists
of the weights that are left, each with an index of 16 bits, are smaller than all weights, lists are stored,
and an event takes index_cycles more; else weights that are 0 take what others take. A delay per synapse takes
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

_NO_PROGRAM = "the program and its other variables take no memory"


@register("hardware.kinds", "processor")
@dataclass(frozen=True)
class Processor(Profile):
    """A microcontroller with one core, which runs any classifier."""

    any_neuron = True

    cycle_nj: Number = figure("nJ", "energy of a cycle of the running processor, whole chip")
    mac_cycles: Number = figure("1", "cycles per 8-bit integer multiply-accumulate")
    float_mac_cycles: Number = figure("1", "cycles per floating-point multiply-accumulate")
    event_cycles: Number = figure("1", "cycles per synaptic event or other addition")
    index_cycles: Number = figure(
        "1", "additional cycles per event if weights are stored as lists with indices"
    )
    update_macs: Number = figure("1", "time of a neuron update, in 8-bit multiply-accumulates")
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
    lists = as_lists(load, _stored_bits(load))
    event = figures["event_cycles"] + figures["index_cycles"] * float(lists)
    reached = load.synapses if lists and load.synapses is not None else load.fan_out
    events = per_count(load, spike=reached)
    neurons = per_count(load, step=sum(load.sizes[1:]) + load.n_resonators)
    return {
        "synaptic_event": np.multiply.outer(event, events),
        "neuron_update": np.multiply.outer(figures["update_macs"] * figures["mac_cycles"], neurons),
    }


def _of_operations(load: Operations, figures: Figures) -> dict[str, Floats]:
    """Return the cycles per count by cause, (D..., 4)."""
    macs, additions, updates = np.eye(4)[1:]
    mac = figures["mac_cycles" if load.number_bits <= 8 else "float_mac_cycles"]
    return {
        "mac": np.multiply.outer(mac, macs),
        "addition": np.multiply.outer(figures["event_cycles"], additions),
        "neuron_update": np.multiply.outer(figures["update_macs"] * figures["mac_cycles"], updates),
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
