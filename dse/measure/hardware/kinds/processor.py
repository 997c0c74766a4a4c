"""A microcontroller that runs the classifier as a program: cycles, times the energy of a cycle.

    energy = cycles x cycle_nj              time = cycles / clock

    cycles of a spiking network, or a classifier of spike counts = wait_factor x the sum of its kinds of work
    cycles of anything else = mac_cycles x multiply-accumulates
                              + wait_factor x (synapse_cycles x additions
                                               + (neuron + update_cycles) x state updates)

Each kind of work has a figure, whose doc says what it is the cycles of.

Anything else is what has no C, and what lacks the count of its work or whose profile lacks these numbers:
runs and profiles of earlier versions.

The program is the C of target `c99`. It is compiled for the core and executed in an emulator, which counts
instructions, loads, stores and taken branches, and Arm's tables without wait states make cycles of them
(`dse.deploy.targets.emulator.Core`): one per instruction, one more per load unless the next load or store
hides it, and two per taken branch; of a Cortex-M7 and a Cortex-M33 by their ratio of CoreMark per MHz to a
Cortex-M4. `benchmarks.instructions` fits the cycles per kind of work on random networks and tests them on
others, compiled by clang, of profiles `*_gcc` by gcc; ranges hold the errors. Encoder and preprocessing are
left out, as elsewhere. Neurons `xylo_lif`, whose states saturate, take 7 cycles per update more than the
CUBA-LIF neurons that they are counted as: networks of them take 6 to 14 % more than predicted.

A spike walks the weights of its targets and adds them up, one by one. A layer at rest is passed over; of any
other, every neuron is looked at in every step, and those that are not at rest are updated. Of every set of
weights, forward or recurrent, the form is the smallest: bytes, words of packed weights where these need at
most 4 bits, before training those of all weights, or lists of the weights that are left, each with the number
of its column. Pruning leaves the same share of a layer's forward and recurrent weights.

wait_factor is 1 by the tables. Low: every load is hidden, and branches refill the pipeline in one cycle.
High: three cycles per branch, and flash that makes weights wait where caches miss.

Cores compute with floats of 32 bits in hardware; doubles, and division by them, are software. Readouts in
integers multiply a weight at a time; kernels are of additions alone.

Multiply-accumulates of numbers of at most 8 bits are the measured integer kernels, those of longer ones
float.

For the limits, weights lie in flash as numbers of 8, 16, 32 or 64 bits, those of classifiers of counts as in
their C; where lists of the weights that are
left, each with an index of 16 bits, are smaller than all weights, lists are stored. A delay per synapse takes
8 bits. States lie in working memory, 32 bits each: current and voltage, and with delays per synapse a current
per step of delay. The two factors of a resonator lie in flash, 16 bits each; those that other neurons share,
the program, its inputs and, of what is no spiking network, activations are not counted.

Between steps the processor sleeps, if it can: it takes sleep_uw, and running power for wake_us per step; its
C counts spikes as they come. Anything else sleeps until its input has arrived, so something else must gather
it; its one wake-up is left out. A step that takes longer than its period is slow, no misfit.

What is counted: `dse.measure.hardware.kinds.linear`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from dse.base.records import Floats, Operations, Workload
from dse.base.registry import register
from dse.measure.hardware.kinds.memory_hierarchy import (
    FACTOR_BITS,
    FACTORS,
    INDEX_BITS,
    STATE_BITS,
    as_lists,
    n_states,
)
from dse.measure.hardware.plan import Misfit, Placement, Plan, of_cycles, per_count
from dse.measure.hardware.profile import Figures, Number, Profile, figure, optional

_MOST_PACKED = 4
"""Bits of a weight up to which the C packs several into a word."""
_SHORT_ROW = 16
"""Weights of a row up to which the C adds them without a loop."""
_NO_PROGRAM = "the program and its other variables take no memory"
_WAKES = "the processor wakes once per step"
_PROGRAM = {
    "addition": (
        *("tally_start", "tally_step", "tally_spike", "tally_add", "tally_word", "tally_count"),
        *("kernel_place", "kernel", "kernel_more"),
    ),
    "mac": (
        *("neighbour", "sample", "feature", "difference", "deviation", "scale"),
        *("single", "single_row", "single_unit"),
        *("double", "double_input", "double_row", "double_unit"),
        *("integer", "integer_input", "integer_row", "integer_unit"),
    ),
}
"""Kinds of work of a classifier of counts, by cause of cost."""
_KINDS = tuple(kind for kinds in _PROGRAM.values() for kind in kinds)


@register("hardware.kinds", "processor")
@dataclass(frozen=True)
class Processor(Profile):
    """A microcontroller with one core, which runs any classifier."""

    any_neuron = True

    cycle_nj: Number = figure("nJ", "energy of a cycle of the running processor, whole chip")
    mac_cycles: Number = figure("1", "cycles per 8-bit integer multiply-accumulate")
    float_mac_cycles: Number = figure("1", "cycles per floating-point multiply-accumulate")
    wait_factor: Number = figure("1", "cycles per cycle of the tables: memory that waits, branches")
    step_cycles: Number = figure("1", "cycles per network step")
    layer_cycles: Number = figure("1", "cycles per layer and step")
    copy_cycles: Number = figure("1", "cycles per step and 32 channels of a delayed copy of the inputs")
    neuron_cycles: Number = figure("1", "cycles per neuron and step in which its layer is not at rest")
    held_cycles: Number = figure("1", "more of a neuron whose synapses have delays, which holds later input")
    update_cycles: Number = figure("1", "cycles per update of a neuron that is not at rest")
    output_cycles: Number = figure("1", "the same of an output neuron: outputs share their decays")
    resonator_cycles: Number = figure("1", "the same in a layer of resonators")
    mixed_cycles: Number = figure("1", "the same in a layer of resonators and others")
    spike_cycles: Number = figure("1", "cycles per spike of an input or a hidden neuron")
    output_spike_cycles: Number = figure("1", "cycles per spike of an output neuron")
    recurrent_cycles: Number = figure("1", "cycles per spike that returns to its own layer")
    row_cycles: Number = figure("1", "cycles per spike and set of weights, beyond those of the weights")
    synapse_cycles: Number = figure("1", "cycles per weight that a spike meets, or addition")
    packed_cycles: Number = figure("1", "the same of weights of 4 bits or fewer, which are packed")
    list_cycles: Number = figure("1", "the same of weights that are stored as lists with indices")
    delayed_cycles: Number = figure("1", "the same of weights with delays of their own")
    delayed_list_cycles: Number = figure("1", "the same of weights with delays of their own in lists")
    sleep_uw: Number = figure("uW", "power of the sleeping processor with memory retained")
    wake_us: Number = figure("us", "time to wake up, at running power")
    clock_mhz: Number = figure("MHz", "clock", whole=True)
    flash_kib: Number = figure("KiB", "flash, for weights", whole=True)
    sram_kib: Number = figure("KiB", "working memory, for states", whole=True)
    tally_start_cycles: Number | None = optional("cycles per inference of a classifier of counts")
    tally_step_cycles: Number | None = optional("cycles per step of counting")
    tally_spike_cycles: Number | None = optional("cycles per input spike")
    tally_add_cycles: Number | None = optional("cycles per input spike that is counted")
    tally_word_cycles: Number | None = optional("cycles per step with a spike and 32 channels, to clear it")
    tally_count_cycles: Number | None = optional("cycles per count, to clear and read it")
    neighbour_cycles: Number | None = optional("cycles per number of a neighbour")
    sample_cycles: Number | None = optional("cycles per neighbour")
    feature_cycles: Number | None = optional("cycles per normal feature of a class")
    difference_cycles: Number | None = optional("cycles per the same, more if the count is not 0")
    deviation_cycles: Number | None = optional("cycles per the same, more if it is not the mean")
    scale_cycles: Number | None = optional("cycles per count that is scaled, to float")
    single_cycles: Number | None = optional("cycles per weight of a unit in float")
    single_row_cycles: Number | None = optional("cycles per input of such units other than 0")
    single_unit_cycles: Number | None = optional("cycles per such unit")
    double_cycles: Number | None = optional("cycles per weight of a unit in double")
    double_input_cycles: Number | None = optional("cycles per count that becomes a double")
    double_row_cycles: Number | None = optional("cycles per input of such units other than 0")
    double_unit_cycles: Number | None = optional("cycles per such unit")
    integer_cycles: Number | None = optional("cycles per weight of a unit in integers")
    integer_input_cycles: Number | None = optional("cycles per count that such units look at")
    integer_row_cycles: Number | None = optional("cycles per input of such units other than 0")
    integer_unit_cycles: Number | None = optional("cycles per such unit")
    kernel_place_cycles: Number | None = optional("cycles per bin and place of a group of kernels")
    kernel_cycles: Number | None = optional("cycles per bin and kernel")
    kernel_more_cycles: Number | None = optional(
        "cycles per bin and threshold passed beyond a kernel's first"
    )

    def plan_network(self, load: Workload, figures: Figures) -> Plan:
        """Return the plan of a spiking network (`Profile.plan`); cores given by hand are ignored."""
        cycles = _cycles(figures, _CAUSES, network_work(load))
        return self._plan(figures, cycles, load.step_ms, self._with_network(load))

    def counts(self, load: Workload | Operations) -> Floats:
        """Return what happens in an inference, (..., F); of a network also the steps with a layer awake."""
        if isinstance(load, Workload):
            return counts_of(load)
        return program_counts(load) if self._knows(load) else load.counts

    def plan_operations(self, load: Operations, figures: Figures) -> Plan:
        """Return the plan of any other classifier (`Profile.plan`)."""
        if not self._knows(load):  # it does not wake before its input has arrived
            return self._plan(figures, _of_operations(load, figures), math.inf, self._with_numbers(load))
        unit = {f"{kind}_cycles": x for kind, x in zip(_KINDS, np.eye(1 + len(_KINDS))[1:], strict=True)}
        # The period of the steps of all points; there may be none.
        step_ms = float(np.max(load.duration_ms / load.program["tally_step"], initial=1e-9))
        return self._plan(figures, _cycles(figures, _PROGRAM, unit), step_ms, self._with_numbers(load))

    def _knows(self, load: Operations) -> bool:
        """Return whether the work of its C is counted, and the profile has the cycles of each kind."""
        stated = self.stated
        return bool(load.program) and all(f"{kind}_cycles" in stated for kind in load.program)

    @property
    def cycles_per_ms(self) -> float:
        """Cycles of a time of computing, such as `Cost.hardware_latency_ms`."""
        return self.clock_mhz.value * 1e3

    def _plan(
        self, figures: Figures, cycles: Mapping[str, Floats], step_ms: float, placement: Placement
    ) -> Plan:
        """Return the plan of some cycles, which wakes once per step."""
        running_mw = figures["cycle_nj"] * self.clock_mhz.value
        waking_mw = running_mw * figures["wake_us"] * 1e-3 / step_ms
        return of_cycles(
            cycles,
            figures["cycle_nj"] * 1e3,
            self.clock_mhz.value,
            static_mw=np.zeros_like(running_mw),  # in the energy of a cycle
            idle_mw=np.minimum(figures["sleep_uw"] * 1e-3 + waking_mw, running_mw),
            placement=placement,
            running_mw=running_mw,
        )

    def _with_network(self, load: Workload) -> Placement:
        """Return the one core, and whether the memories hold the weights and the states."""
        beside = _bytes(load.delay_bits) * load.delayed_share
        n_weights = sum(load.dense)
        if as_lists(load, 8 * (_bytes(load.weight_bits) + beside)):
            n_weights, beside = sum(load.stored or ()), beside + INDEX_BITS // 8
        factors = load.n_resonators * FACTORS * FACTOR_BITS // 8
        misfits = _flash_misfits(n_weights, load.weight_bits, beside, self._flash_bytes, factors)
        misfits += _sram_misfits(load, int(self.sram_kib.value) * 1024)
        return Placement((1,), misfits, assumptions=(_NO_PROGRAM, _WAKES))

    def _with_numbers(self, load: Operations) -> Placement:
        """Return the one core, and whether the flash holds the stored numbers."""
        n_weights = int(np.ceil(np.max(load.n_weights, initial=0)))
        misfits = _flash_misfits(
            n_weights,
            load.stored_bits or load.number_bits,
            0,
            self._flash_bytes,
            is_fixed=load.stored_bits is not None,
        )
        sleeps = _WAKES if self._knows(load) else "the processor sleeps until all input has arrived"
        return Placement((1,), misfits, assumptions=(_NO_PROGRAM, sleeps))

    @property
    def _flash_bytes(self) -> int:
        return int(self.flash_kib.value) * 1024


@dataclass(frozen=True)
class _Rows:
    """A set of weights, from the spikes of one layer to the neurons of one.

    source: the layer that spikes, input first. is_recurrent: whether it is the layer of the neurons itself.
    figure: what a weight takes. weights: that a spike meets. is_short: whether rows are added without a loop.
    """

    source: int
    is_recurrent: bool
    figure: str
    weights: float
    is_short: bool


_WEIGHTS = ("synapse", "packed", "list", "delayed", "delayed_list")


def counts_of(load: Workload) -> Floats:
    """Return `Workload.counts` and the steps in which any neuron of each layer is updated, (..., F)."""
    if load.awake is not None:
        awake = np.asarray(load.awake, np.float64)
    else:
        updates = load.counts[..., 1 + len(load.sizes) :]
        awake = np.minimum(updates, np.asarray(load.n_steps, np.float64)[..., None])
    return np.concatenate([load.counts, awake], axis=-1)


def network_work(load: Workload) -> dict[str, Floats]:
    """Return how often each kind of work is done, by its figure: (F,) per count of `Processor.counts`."""
    n_after = load.sizes[1:]
    rows = _rows(load)
    kinds = [_update_figure(load, k) for k in range(len(n_after))]
    words = (load.copies - 1) * -(-(load.sizes[0] // load.copies) // 32)
    reached, returned = np.zeros((2, len(load.sizes)))
    work: dict[str, Floats] = {}
    for each in rows:
        reached[each.source] += not each.is_short
        returned[each.source] += each.is_recurrent
    for name in _WEIGHTS:
        met = np.zeros(len(load.sizes))
        for each in rows:
            met[each.source] += each.weights * (each.figure == f"{name}_cycles")
        work[f"{name}_cycles"] = _per_count(load, spike=met.tolist())
    for name in ("update", "output", "resonator", "mixed"):
        work[f"{name}_cycles"] = _per_count(load, update=[float(kind == f"{name}_cycles") for kind in kinds])
    is_output = [0.0] * len(n_after) + [1.0]
    return work | {
        "step_cycles": _per_count(load, step=1.0),
        "layer_cycles": _per_count(load, step=float(len(n_after))),
        "copy_cycles": _per_count(load, step=float(words)),
        "neuron_cycles": _per_count(load, awake=n_after),
        "held_cycles": _per_count(load, awake=[n * x for n, x in zip(n_after, _delayed(load), strict=True)]),
        "spike_cycles": _per_count(load, spike=[1 - x for x in is_output]),
        "output_spike_cycles": _per_count(load, spike=is_output),
        "recurrent_cycles": _per_count(load, spike=returned.tolist()),
        "row_cycles": _per_count(load, spike=reached.tolist()),
    }


_CAUSES = {
    "step": ("step", "layer", "copy"),
    "synaptic_event": ("spike", "output_spike", "recurrent", "row", *_WEIGHTS),
    "neuron_update": ("neuron", "held", "update", "output", "resonator", "mixed"),
}
"""Kinds of work of a network, by cause of cost."""


def _cycles(
    figures: Figures, causes: Mapping[str, Sequence[str]], work: Mapping[str, Floats]
) -> dict[str, Floats]:
    """Return the cycles per count by cause, (D..., F), of work that the profile has figures of."""
    return {
        cause: np.sum(
            [
                np.multiply.outer(figures["wait_factor"] * figures[f"{kind}_cycles"], work[f"{kind}_cycles"])
                for kind in kinds
                if f"{kind}_cycles" in figures
            ],
            axis=0,
        )
        for cause, kinds in causes.items()
    }


def _per_count(load: Workload, *, awake: Sequence[float] = (), **numbers: Any) -> Floats:
    """Return a number for each count of `Processor.counts`, (F,) (`dse.measure.hardware.plan.per_count`)."""
    return np.concatenate([per_count(load, **numbers), awake or [0.0] * (len(load.sizes) - 1)])


def _update_figure(load: Workload, layer: int) -> str:
    resonators, n = (load.resonators or (0,) * len(load.recurrent))[layer], load.sizes[layer + 1]
    if resonators:
        return "resonator_cycles" if resonators == n else "mixed_cycles"
    return "output_cycles" if layer == len(load.recurrent) - 1 else "update_cycles"


def _rows(load: Workload) -> list[_Rows]:
    """Return all sets of weights of a network."""
    dense = load.dense
    stored = load.stored or dense
    is_delayed = _delayed(load)
    bits = iter(load.needed_bits or (load.weight_bits,) * 2 * len(dense))
    rows = []
    for k, (before, n) in enumerate(pairwise(load.sizes)):
        share = stored[k] / dense[k]
        for source, n_inputs in [(k, before), *([(k + 1, n)] if load.recurrent[k] else [])]:
            is_later = is_delayed[k] and source == k
            form = _form(n_inputs, n, share, next(bits), load.delay_bits if is_later else 0)
            left = share if load.synapses is None else load.synapses[source] / max(load.fan_out[source], 1)
            rows.append(
                _Rows(
                    source=source,
                    is_recurrent=source > k,
                    figure=_LATER.get(form, form) if is_later else form,
                    weights=n * (left if form == "list_cycles" else 1.0),
                    is_short=form == "synapse_cycles" and n <= _SHORT_ROW and not is_later,
                )
            )
    return rows


_LATER = {"synapse_cycles": "delayed_cycles", "list_cycles": "delayed_list_cycles"}


def _delayed(load: Workload) -> tuple[bool, ...]:
    """Return whether the forward synapses of each layer after the input have delays."""
    return load.delayed or (load.delay_bits > 0,) * len(load.recurrent)


def _form(n_inputs: int, n: int, share: float, bits: int, delay_bits: int) -> str:
    """Return what a weight takes in the smallest form of a set of weights, of equal ones the plainest.

    A share of n weights in each of the rows is left; without delays, these take 0 bits.
    """
    each, n_left = _bytes(bits) + _bytes(delay_bits), n_inputs * n * share
    sizes = {"synapse_cycles": float(n_inputs * n * each)}
    if bits <= _MOST_PACKED and not delay_bits:
        sizes["packed_cycles"] = n_inputs * 4.0 * -(-n // (32 // max(bits, 2)))
    column, offset = 1 if n <= 256 else 2, 2 if n_left < 2**16 else 4
    sizes["list_cycles"] = (n_inputs + 1) * offset + n_left * (each + column)
    return min(sizes, key=lambda form: sizes[form])


def program_counts(load: Operations) -> Floats:
    """Return 1, and how often each kind of work of a classifier of counts is done, (..., F)."""
    none = np.zeros(np.shape(load.macs))
    return np.stack([none + 1, *(none + load.program.get(kind, none) for kind in _KINDS)], axis=-1)


def _of_operations(load: Operations, figures: Figures) -> dict[str, Floats]:
    """Return the cycles per count by cause, (D..., 4)."""
    macs, additions, updates = np.eye(4)[1:]
    mac = figures["mac_cycles" if load.number_bits <= 8 else "float_mac_cycles"]
    cycles = figures["wait_factor"]
    update = figures["neuron_cycles"] + figures["update_cycles"]
    return {
        "mac": np.multiply.outer(mac, macs),
        "addition": np.multiply.outer(cycles * figures["synapse_cycles"], additions),
        "neuron_update": np.multiply.outer(cycles * update, updates),
    }


def _bytes(bits: int) -> int:
    """Return the bytes of the shortest type that holds so many bits: 1, 2, 4, 8; of no bits, none."""
    return 1 << (-(-bits // 8) - 1).bit_length() if bits else 0


def _flash_misfits(
    n_weights: int, bits: int, beside: float, flash: int, factors: int = 0, *, is_fixed: bool = False
) -> tuple[Misfit, ...]:
    """Return the misfit of numbers of some bits in the bytes of a flash, where there is one.

    In the mean some bytes lie beside each, and bytes of the neurons' own factors beside all. Fixed numbers
    cannot be shorter.
    """
    size, flash = _bytes(bits) + beside, flash - factors
    if n_weights * size <= flash:
        return ()
    # The longest numbers that fit are the smallest change.
    types = () if is_fixed else (_bytes(bits) >> halved for halved in range(1, _bytes(bits).bit_length()))
    shorter = next((each for each in types if n_weights * (each + beside) <= flash), None)
    if shorter is None:
        change = f"at most {flash // size:.0f} weights instead of {n_weights}"
    else:
        change = f"weights of {8 * shorter} bits instead of {bits}"
    left = f" beside {factors} of neurons' factors" if factors else ""
    text = f"weights of {n_weights * size:.0f} bytes, {flash} bytes of flash{left}"
    return (Misfit("flash_kib", text, change),)


def _sram_misfits(load: Workload, sram: int) -> tuple[Misfit, ...]:
    """Return the misfit of the states, where there is one."""
    n_neurons = sum(load.sizes[1:])

    def needed(delay_bits: int) -> int:
        return n_states(load, delay_bits) * STATE_BITS // 8

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
