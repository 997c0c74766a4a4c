"""Energy of arithmetic and of memory at 45 nm: fetching numbers costs more than computing with them.

No chip is meant: no time, no static power, no limits. Weights lie in one memory and states in another, each
the smallest that holds them: on-chip memory (SRAM) of 8 KiB, 32 KiB or 1 MiB, beyond that DRAM.

    access(value of b bits) = energy of an access of 64 bits x min(1, fetched_per_used x b / 64)

    synaptic event      an 8-bit addition; a weight is read, the state that it is added to read and written
    neuron update       the arithmetic of two states; both are read and written
    multiply-accumulate a weight is read; its operand and its sum stay in registers
    addition            where nothing spikes: a counter is read and written (8 KiB hold all of them)

A state takes 32 bits (registers of 24) and a neuron has two, current and voltage; a delay per synapse needs a
current per step of delay. Where lists of the weights that are left, each with an index of 16 bits, are
smaller than all weights, lists are stored, and only weights other than 0 are events. Neurons are updated as
counted: what is 0 and gets no input is left alone. A resonator has two factors of its own, 16 bits each,
beside its states; its update reads them and has twice the arithmetic, four multiplications instead of two. Of
design points together, the memory is what the largest needs.

What is counted: `dse.measure.hardware.kinds.linear`.
Sources: SpikingJelly's estimators and Horowitz 2014 (REFERENCES.md).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dse.base.records import Floats, Operations, Workload
from dse.base.registry import register
from dse.measure.hardware.plan import Plan, energy_only, per_count
from dse.measure.hardware.profile import Figures, Number, Profile, figure

INDEX_BITS = 16
"""Bits of the index of the target neuron in a list of weights."""
STATE_BITS = 32
"""Bits of a state in memory; the registers of Loihi have 24."""
FACTORS, FACTOR_BITS = 2, 16
"""Factors of a resonator, and the bits of one in memory: 12 and a sign."""

_WORD_BITS = 64
_MEMORIES = ((8, "sram_8_kib_pj"), (32, "sram_32_kib_pj"), (1024, "sram_1_mib_pj"))


@register("hardware.kinds", "memory_hierarchy")
@dataclass(frozen=True)
class MemoryHierarchy(Profile):
    """Arithmetic and memory accesses of any classifier, without static power, cores or time."""

    any_neuron = True

    int8_addition_pj: Number = figure("pJ", "an 8-bit integer addition")
    int8_mac_pj: Number = figure("pJ", "an 8-bit integer multiply-accumulate")
    float_mac_pj: Number = figure("pJ", "a multiply-accumulate of numbers of more than 8 bits")
    update_pj: Number = figure("pJ", "the arithmetic of a neuron's update")
    sram_8_kib_pj: Number = figure("pJ", "an access of 64 bits to a memory of up to 8 KiB")
    sram_32_kib_pj: Number = figure("pJ", "the same, up to 32 KiB")
    sram_1_mib_pj: Number = figure("pJ", "the same, up to 1 MiB")
    dram_pj: Number = figure("pJ", "the same, above 1 MiB")
    fetched_per_used: Number = figure("1", "bits fetched per bit used, at most one access per value")

    def plan_network(self, load: Workload, figures: Figures) -> Plan:
        """Return the plan of a spiking network (`Profile.plan`)."""
        return energy_only(_of_network(load, figures))

    def plan_operations(self, load: Operations, figures: Figures) -> Plan:
        """Return the plan of any other classifier (`Profile.plan`)."""
        return energy_only(_of_operations(load, figures))


def as_lists(load: Workload, weight_bits: float) -> bool:
    """Return whether lists of the weights that are left take less memory than all weights do."""
    if load.stored is None:
        return False
    return sum(load.stored) * (weight_bits + INDEX_BITS) < sum(load.dense) * weight_bits


def n_states(load: Workload, delay_bits: int) -> int:
    """Return how many states the neurons keep: current and voltage, and a current per step of delay."""
    delayed = load.delayed or (True,) * len(load.recurrent)
    later = 2**delay_bits if delay_bits else 0
    return sum(n * (2 + later * late) for n, late in zip(load.sizes[1:], delayed, strict=True))


def _of_network(load: Workload, figures: Figures) -> dict[str, Floats]:
    """Return the energy per count by cause, (D..., F)."""
    bits = load.number_bits
    n_weights = sum(load.dense)
    reached: tuple[float, ...] = load.fan_out
    if load.stored is not None and as_lists(load, bits):
        n_weights, bits = sum(load.stored), bits + INDEX_BITS
        reached = reached if load.synapses is None else load.synapses
    state_bits = n_states(load, load.delay_bits) * STATE_BITS
    state_bits += load.n_resonators * FACTORS * FACTOR_BITS
    weight = _access_pj(figures, n_weights * bits, bits)
    state, factor = (_access_pj(figures, state_bits, bits) for bits in (STATE_BITS, FACTOR_BITS))
    events = per_count(load, spike=reached)
    updates, work = (per_count(load, update=x) for x in ([1.0] * len(load.update_work), load.update_work))
    return {
        "addition": np.multiply.outer(figures["int8_addition_pj"], events),
        "neuron_update": np.multiply.outer(figures["update_pj"], work),
        "weight_memory": np.multiply.outer(weight, events),
        "state_memory": np.multiply.outer(state, 2 * events + 4 * updates)
        + np.multiply.outer(factor, FACTORS * (work - updates)),
    }


def _of_operations(load: Operations, figures: Figures) -> dict[str, Floats]:
    """Return the energy per count by cause, (D..., 4)."""
    n_weights = float(np.max(load.n_weights, initial=0))
    weight = _access_pj(figures, n_weights * load.number_bits, load.number_bits)
    state = _access_pj(figures, 0.0, STATE_BITS)
    macs, additions, updates = np.eye(4)[1:]
    # Additions of a spiking classifier are of weights; those of any other count spikes.
    return {
        "mac": np.multiply.outer(figures["int8_mac_pj" if load.number_bits <= 8 else "float_mac_pj"], macs),
        "addition": np.multiply.outer(figures["int8_addition_pj"], additions),
        "neuron_update": np.multiply.outer(figures["update_pj"], updates),
        "weight_memory": np.multiply.outer(weight, macs + additions * load.is_spiking),
        "state_memory": np.multiply.outer(state, 2 * additions + 4 * updates),
    }


def _access_pj(figures: Figures, stored_bits: float, value_bits: float) -> Floats:
    """Return the energy of reading or writing one value in the smallest memory that holds all, (D...)."""
    fits = (name for kib, name in _MEMORIES if stored_bits <= kib * 1024 * 8)
    access = figures[next(fits, "dram_pj")]
    share = np.minimum(1.0, figures["fetched_per_used"] * value_bits / _WORD_BITS)
    return np.asarray(access * share)
