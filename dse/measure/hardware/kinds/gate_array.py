"""A field-programmable gate array that holds one network: a circuit that takes neurons and weights in turn.

The circuit is the Verilog of targets `ice40` and `ecp5` (dse/deploy/verilog/blocks). Clock cycles of an
inference, from counts (T network steps of N neurons, P of them per input step; C copies of the inputs in W
words of 16 channels; s_0 input spikes, s_l spikes of layer l, n_1 and f_l weights that such a spike meets):

    cycles = T (5 N + 1 + (1 + W + (C W + C (P - 1) / 2) word_cycles) / P)
             + s_0 (n_1 + 3 + scan_cycles) + sum over layers l with f_l > 0 of s_l (f_l + 3)

Exact but for the words and the places in them: these are hidden while weights are added up. A weight of 0 is
added like any other, unless a network has so many that lists of the others take fewer bits (`Stored`): then
n_1 and f_l are means over these, and a spike takes 3 cycles more, but where its list is empty. A step that
takes longer than its period is slow, no misfit.

Cells of a circuit hardly depend on the network: cell costs are fitted to placed circuits (benchmarks.cells).
Blocks of memory follow from words and their bits, as yosys divides them: a part is as many words as a block
has rows, its bits lie in any columns of any blocks, those that a write sets together side by side, and cells
choose the part that is read. Before training some bits are taken as they mostly are: states have 26; weights
of fewer than 8 bits have 2 more, as scales of layers differ; a sum of f weights has 3 fewer than f of the
largest; delays fill their bits; decisions are early. The target counts those of the trained network. Two
multipliers are all that any circuit takes.

Energy: leakage and the clock flow at any time, as nothing stops the clock between steps; what is dynamic is
that of a cell per cycle of computing, with its share of the memories that are read.

Sources: those of the profiles.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np

from dse.base.records import Floats, Workload
from dse.base.registry import register
from dse.measure.hardware.plan import Misfit, Placement, Plan, of_cycles, per_count
from dse.measure.hardware.profile import Figures, Number, Profile, count, figure, optional

_NEURON_CYCLES, _ROW_CYCLES = 5, 3
LIST_CYCLES = 3
"""More of a spike whose weights are a list."""
WORD_CHANNELS = 16
"""Channels whose spikes lie in one word."""
_STATE_BITS, _KEEP_BITS, _COUNT_BITS, _SHARE_BITS = 26, 12, 12, 12
_MOST_WEIGHT_BITS, _SCALE_BITS, _SPARE_BITS = 8, 2, 3
_ROUGHLY = 64
"""Weights of which a multiple is said to fit."""
_FEWER = {
    "sums": "fewer neurons or shorter delays of synapses: {} are for what arrives later",
    "states": "fewer neurons: {} are for states",
    "keeps": "fewer neurons: {} are for decays",
    "inputs": "fewer channels or shorter input delays: {} are for input spikes",
    "counts": "fewer outputs: {} are for counts",
    "lists": "fewer channels, copies of them or neurons: {} are for where the weights of each begin",
}
_WRITTEN = ("sums", "states", "inputs", "counts", "levels")

Memories = Mapping[str, tuple[int, int]]
"""Words and bits of a word, by what a memory holds."""


@dataclass(frozen=True)
class Stored:
    """How a circuit holds its weights: rows of all, or lists of those that are not 0.

    n_words, n_bits: of what is held. n_lists: of lists; 0: rows.
    address_bits: of a place among the weights, or of a list, and of one beyond the last word of channels.
    """

    n_words: int
    n_bits: int
    n_lists: int
    address_bits: int

    @classmethod
    def smallest(
        cls, *, n_all: int, n_used: int, n_bits: int, n_neurons: int, n_rows: int, n_first: int
    ) -> Self:
        """Return what takes fewer bits.

        Args:
            n_all: weights.
            n_used: those of them that are not 0.
            n_bits: of a weight and its delay.
            n_neurons: of all layers.
            n_rows: neurons and copies of input channels.
            n_first: neurons of the first layer.
        """
        rows = cls(n_all, n_bits, 0, (n_all + WORD_CHANNELS * n_first).bit_length())
        place_bits = max(n_used, n_rows + WORD_CHANNELS).bit_length()
        lists = cls(n_used, n_bits + n_neurons.bit_length(), n_rows, place_bits)
        return min(rows, lists, key=lambda x: sum(words * width for words, width in x.memories.values()))

    @property
    def is_sparse(self) -> bool:
        return self.n_lists > 0

    @property
    def memories(self) -> Memories:
        """Words and bits of a word of its memories."""
        begins = {"lists": (self.n_lists + 1, self.address_bits)} if self.is_sparse else {}
        return {"weights": (self.n_words, self.n_bits), **begins}


@register("hardware.kinds", "gate_array")
@dataclass(frozen=True)
class GateArray(Profile):
    """A field-programmable gate array that holds one network of CUBA-LIF neurons as a circuit."""

    cells: Number = count("logic cells")
    memory_blocks: Number = count("blocks of memory")
    block_bits: Number = count("bits of a block of memory")
    narrowest_bits: Number = count("bits of the narrowest word of a block that is used")
    widest_bits: Number = count("bits of its widest word; halved, rounded down, are the others")
    clock_mhz: Number = figure("MHz", "clock that the board gives", whole=True)
    circuit_cells: Number = figure("1", "cells of any circuit")
    address_cells: Number = figure("1", "more per bit of a place among the weights")
    share_cells: Number = figure("1", "more per bit of what early decisions compare")
    slot_cells: Number = figure("1", "more per bit of the number of a step whose sums are held")
    list_cells: Number = figure("1", "more where weights are lists of those that are not 0")
    level_cells: Number = figure("1", "more per bit of a level, where samples are encoded")
    word_cycles: Number = figure("1", "cycles per word of 16 channels and input step")
    scan_cycles: Number = figure("1", "cycles until an input spike is found in its word")
    cell_pj: Number = figure("pJ", "dynamic energy per cycle of computing and cell, memories included")
    cell_clock_pj: Number = figure("pJ", "energy of the clock per cycle and cell, at any time")
    clock_pj: Number = figure("pJ", "energy of the clock per cycle, at any time")
    leakage_mw: Number = figure("mW", "power of the chip without a clock")
    written_bits: Number | None = count(
        "bits of a word that are written together (default: 1)", optional=True
    )
    choice_bits: Number | None = count(
        "bits to choose among that cost tools as much as a block", optional=True
    )
    choice_cells: Number | None = optional("more cells per bit of a memory's parts but the first")

    def plan_network(self, load: Workload, figures: Figures) -> Plan:
        """Return the plan of a spiking network (`Profile.plan`)."""
        memories = _memories(load)
        work = self.cell_work(_stored(load), memories, _SHARE_BITS, _slot_bits(load))
        cells = np.asarray(sum(figures[name] * n for name, n in work.items() if name in figures))
        mhz = self.clock_mhz.value
        static_mw = figures["leakage_mw"] + mhz * 1e-3 * (
            figures["clock_pj"] + cells * figures["cell_clock_pj"]
        )
        return of_cycles(
            _cycles(load, figures),
            cells * figures["cell_pj"],
            mhz,
            static_mw=static_mw,
            idle_mw=static_mw,
            placement=self._placement(memories, round(self.n_cells(work))),
        )

    @property
    def cycles_per_ms(self) -> float:
        """Cycles of a time of computing, such as `Cost.hardware_latency_ms`."""
        return self.clock_mhz.value * 1e3

    def cell_work(
        self, stored: Stored, memories: Memories, share_bits: int, slot_bits: int
    ) -> dict[str, float]:
        """Return what the cells of a circuit are for, by its figure.

        Args:
            stored: how it holds its weights.
            memories: all of them.
            share_bits: of the products that early decisions compare; 0: there are none.
            slot_bits: of the number of a step whose sums are held.
        """
        return {
            "circuit_cells": 1.0,
            "address_cells": stored.address_bits,
            "share_cells": share_bits,
            "slot_cells": slot_bits,
            "choice_cells": sum(others for _, others in self._divided(memories).values()),
            "list_cells": stored.is_sparse,
        }

    def n_cells(self, work: Mapping[str, float]) -> float:
        """Return the cells of what `cell_work` says."""
        figures = self.at("value")
        return sum(figures[name] * n for name, n in work.items() if name in figures)

    def n_blocks(self, memories: Memories) -> dict[str, int]:
        """Return the blocks that each memory takes."""
        return {name: n for name, (n, _) in self._divided(memories).items()}

    def _divided(self, memories: Memories) -> dict[str, tuple[int, int]]:
        return {name: self.divided(*shape, name in _WRITTEN) for name, shape in memories.items()}

    def divided(self, words: int, n_bits: int, is_written: bool = False) -> tuple[int, int]:
        """Return the blocks of words of some bits, and the bits of all parts but one.

        Of the widths of a block tools take that of the lowest price.
        """
        if not words or not n_bits:
            return 0, 0
        written = int(self.written_bits.value) if is_written and self.written_bits else 1
        price = int(self.choice_bits.value) if self.choice_bits else math.inf  # blocks alone count
        options, width = [], int(self.widest_bits.value)
        while width >= self.narrowest_bits.value:
            rows = 1 << ((int(self.block_bits.value) // width).bit_length() - 1)
            unit = min(width, written)
            parts, columns = -(-words // rows), -(-n_bits // unit) * unit
            n, others = -(-parts * columns // width), (parts - 1) * n_bits
            options.append((n * price + others, n, others))
            width //= 2
        return min(options)[1:]

    def misfit(self, memories: Memories) -> Misfit | None:
        """Return why the chip cannot hold some memories, and what of them would fit; None if it can."""
        taken = self.n_blocks(memories)
        total, most = sum(taken.values()), int(self.memory_blocks.value)
        if total <= most:
            return None
        left = most - total + taken["weights"]
        # Where the others alone are too many, fewer weights would not help.
        largest = max((name for name in taken if name != "weights" or left > 0), key=lambda name: taken[name])
        if largest in _FEWER:
            change = _FEWER[largest].format(taken[largest])
        else:
            n_weights, n_bits = memories["weights"]
            fits = (n for n in range(0, n_weights, _ROUGHLY) if self.divided(n, n_bits)[0] <= left)
            n = max(fits, default=0)
            change = f"{n} weights of {n_bits} bits, what belongs to each included, instead of {n_weights}"
        return Misfit("memory_blocks", f"{total} blocks of memory, {most} at most", change)

    def _placement(self, memories: Memories, n_cells: int) -> Placement:
        misfit = self.misfit(memories)  # alone, as the cells to choose among so many blocks are none
        misfits = [misfit] if misfit else self.exceeded([("cells", n_cells, "logic cells")])
        blocks = sum(self.n_blocks(memories).values())
        assumption = f"{n_cells} cells, {blocks} blocks of memory and two multipliers"
        return Placement((1,), tuple(misfits), assumptions=(assumption,))


def _slot_bits(load: Workload) -> int:
    return max(1, load.delay_bits)


def _weight_bits(load: Workload) -> int:
    """Return the bits of a weight before training."""
    return max(load.weight_bits, min(_MOST_WEIGHT_BITS, load.weight_bits + _SCALE_BITS))


def _stored(load: Workload) -> Stored:
    return Stored.smallest(
        n_all=sum(load.dense),
        n_used=sum(load.stored or load.dense),
        n_bits=_weight_bits(load) + load.delay_bits,
        n_neurons=sum(load.sizes[1:]),
        n_rows=sum(load.sizes),
        n_first=load.sizes[1],
    )


def _memories(load: Workload) -> Memories:
    """Return the memories of a network before it is trained."""
    n = sum(load.sizes[1:])
    most_inputs = max(
        of_layer // size for of_layer, size in zip(load.stored or load.dense, load.sizes[1:], strict=True)
    )
    n_words = -(-load.sizes[0] // load.copies // WORD_CHANNELS)
    of_input = max(1, (load.n_slots - 1).bit_length()) + max(1, (n_words - 1).bit_length())
    return {
        **_stored(load).memories,
        "sums": (n << _slot_bits(load), max(2, _weight_bits(load) + most_inputs.bit_length() - _SPARE_BITS)),
        "states": (2 * n, _STATE_BITS),
        "keeps": (2 * n, _KEEP_BITS),
        "inputs": (1 << of_input, WORD_CHANNELS),
        "counts": (1 << max(1, (load.sizes[-1] - 1).bit_length()), _COUNT_BITS),
    }


def _cycles(load: Workload, figures: Figures) -> dict[str, Floats]:
    """Return the cycles per count by cause, (D..., F)."""
    copies, parts = load.copies, load.steps_per_sample
    n_words = -(-load.sizes[0] // copies // WORD_CHANNELS)
    reached: tuple[float, ...] = load.fan_out
    row_cycles = _ROW_CYCLES
    if _stored(load).is_sparse:
        reached, row_cycles = load.synapses or load.fan_out, _ROW_CYCLES + LIST_CYCLES
    of_spike = [n + row_cycles if most else 0.0 for n, most in zip(reached, load.fan_out, strict=True)]
    step, spike = per_count(load, step=1.0), per_count(load, spike=of_spike)
    input_spike = per_count(load, spike=[1.0, *(0.0 for _ in load.sizes[1:])])
    words = (copies * n_words + copies * (parts - 1) / 2) / parts
    return {
        "neuron_update": np.zeros_like(figures["word_cycles"])[..., None]
        + step * (_NEURON_CYCLES * sum(load.sizes[1:])),
        "synaptic_event": spike + np.multiply.outer(figures["scan_cycles"], input_spike),
        "step": step * (1 + (1 + n_words) / parts) + np.multiply.outer(figures["word_cycles"] * words, step),
    }
