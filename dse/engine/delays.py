"""Delays per synapse: weighted sums over spikes that arrive later, and their gradients.

A spike of input i at step t reaches neuron j at step t + d_ij; beyond the window it is lost:

    z_j[t] = sum over i of w_ij s_i[t - d_ij]

With g_j[t] = dL/dz_j[t], which is 0 outside the window:

    dL/dw_ij   = sum over t of s_i[t] g_j[t + d_ij]
    dL/dd_ij   = w_ij sum over t of s_i[t] (g_j[t + d_ij + 1] - g_j[t + d_ij - 1]) / 2
    dL/ds_i[t] = sum over j of w_ij g_j[t + d_ij]

The second, over the spikes that arrive, is the central difference over whole delays; a delay is learnt as a
real number and runs rounded, straight through (Hammouamri et al. 2024 interpolate; REFERENCES.md).

A delay that differs from neuron to neuron spoils every vector of neurons, so vectors run along time here: the
spikes of an input are a train of bits, 64 steps a word, and a delay shifts the train. Where a word has few
spikes, dse.engine.arrivals is faster.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numba.extending import overload

from dse.engine import kernels
from dse.engine.adam import BETA_1, BETA_2, EPSILON
from dse.engine.layout import LANES, aligned, packed, padded, width_at
from dse.native.compiled import compiled
from dse.native.simd import (
    LANES_64,
    as_type_of,
    load,
    mask_of,
    select,
    splat,
    store,
    summed,
    transpose,
    zeros,
)
from dse.records import Array

MOST = 62
"""Longest delay, network steps: what 6 bits hold on Loihi, whose 63 is taken."""

_kernel = compiled()
_part = compiled(forceinline=True)

WORD = 64
SEGMENT = 256  # an int16 holds the sum of 256 int8 weights
TILE_WORDS = 32  # of a neuron's dL/dz and its differences: 16 KiB of float32, half of a first-level cache


@dataclass(frozen=True)
class Delays:
    """Delays of a layer's synapses in training: real masters in blocks, their gradient, Adam's moments.

    table: int8, the masters rounded.
    unit: (column,) ones: a learning rate of 1 moves every delay by a step.
    longest: masters stay between 0 and this.
    """

    n_rows: int
    masters: Array
    gradient: Array
    first: Array
    second: Array
    table: Array
    unit: Array
    longest: int

    @classmethod
    def of(cls, masters: Array, longest: int, kind: Any) -> Delays:
        """Return delays at their start, (input, neuron), with gradients of a type."""
        n_rows, n_columns = masters.shape
        packs = packed(masters, np.float32)
        table = packed(np.rint(masters), np.int8)
        first, second = (aligned(packs.size, np.float32) for _ in range(2))
        unit = aligned(padded(n_columns), np.float32)
        unit[:n_columns] = 1
        return cls(n_rows, packs, aligned(packs.size, kind), first, second, table, unit, longest)

    def update(self, learning_rate: float, steps: int) -> None:
        """Take Adam's step `steps`, from 1, and round anew."""
        kernels.adam(
            self.masters,
            self.gradient,
            self.first,
            self.second,
            self.n_rows,
            len(self.unit),
            self.unit,
            1.0,
            learning_rate / (1 - BETA_1**steps),
            BETA_1,
            BETA_2,
            1 / (1 - BETA_2**steps),
            EPSILON,
            self.table,
            1.0,
            0.0,
            float(self.longest),
        )
        # A master beyond an end would have no gradient and never come back.
        np.clip(self.masters, 0, self.longest, out=self.masters)

    def state(self) -> dict[str, Array]:
        """Return a copy of what an update reads and writes."""
        return {name: getattr(self, name).copy() for name in ("masters", "first", "second", "table")}

    def restore(self, state: Mapping[str, Array]) -> None:
        """Take over the numbers of a state."""
        for name in ("masters", "first", "second", "table"):
            np.copyto(getattr(self, name), state[name], casting="no")


@_part
def words_of(n_steps: int) -> int:
    """Return the words of 64 steps that a sample takes."""
    return (n_steps + WORD - 1) // WORD


@_kernel
def trains_of(
    offsets: Array, index: Array, first_row: int, n_samples: int, n_steps: int, by_input: int, out: Array
) -> None:
    """Set the bits of some samples' spikes in cleared trains; bit b of word k is step 64 k + b.

    Args:
        offsets: row r lists `index[offsets[r]:offsets[r + 1]]`.
        index: input numbers.
        first_row: which rows.
        n_samples: of them.
        n_steps: of a sample.
        by_input: 0: word after word of all inputs; else the trains of an input together.
        out: (2, sample, word, input) uint64, or (2, input, sample, word): a word, and 63 steps of the last.
    """
    for n in range(n_samples):
        for t in range(n_steps):
            row, word, bit = first_row + n * n_steps + t, t // WORD, np.uint64(1) << np.uint64(t % WORD)
            for e in range(offsets[row], offsets[row + 1]):
                i = index[e]
                if by_input:
                    out[0, i, n, word] |= bit
                else:
                    out[0, n, word, i] |= bit
    if by_input:
        out[1, :, :, 1:] = out[0, :, :, :-1] >> np.uint64(1)
    else:
        out[1, :, 1:] = out[0, :, :-1] >> np.uint64(1)


@_part
def _later(now: Any, before: Any, delay: Any) -> Any:
    """Return a word of a train that is delayed, given 63 steps of the word before it."""
    return (now << delay) | (before >> (np.uint64(WORD - 1) - delay))


@_part
def _sum_word(trains: Array, n: int, k: int, weights: Array, delays: Array, c: int, out: Array) -> Any:
    """Return 64 steps of a neuron's weighted input as a vector of `out`'s type; int16 weights sum exactly."""
    total = zeros(out, LANES_64)
    n_inputs = weights.shape[1]
    for first in range(0, n_inputs, SEGMENT):
        part = zeros(weights, LANES_64)
        for i in range(first, min(first + SEGMENT, n_inputs)):
            fired = _later(trains[0, n, k, i], trains[1, n, k, i], np.uint64(delays[c, i]))
            if fired != np.uint64(0):
                part = select(mask_of(fired, LANES_64), part + splat(weights[c, i], part), part)
        total = total + as_type_of(part, out)
    return total


@_kernel
def turn(blocks: Array, n_samples: int, n_steps: int, out: Array) -> None:
    """Lay dL/dz out by neuron.

    Args:
        blocks: columns in blocks (dse.engine.layout).
        n_samples: of it.
        n_steps: of a sample.
        out: (padded neuron, sample, step), cleared; there may be more steps than n_steps.
    """
    n_rows = n_samples * n_steps
    n_columns, steps = out.shape[0], out.shape[2]
    whole = n_steps - n_steps % LANES
    flat = out.ravel()
    column = 0
    while column < n_columns:
        width = width_at(column, n_columns)
        for group in range(0, width, LANES):
            for n in range(n_samples):
                at = n_rows * column + n * n_steps * width + group
                to = ((column + group) * n_samples + n) * steps
                for t in range(0, whole, LANES):
                    transpose(blocks, at + t * width, width, flat, to + t, n_samples * steps)
                for t in range(whole, n_steps):
                    for c in range(LANES):
                        flat[to + c * n_samples * steps + t] = blocks[at + t * width + c]
        column += width


def summands(table: Array, out: Array, n_neurons: int, n_inputs: int) -> Array:
    """Return an empty matrix for the weights of a table as they are summed: int16 for int8, else `out`'s."""
    return np.empty((n_neurons, n_inputs), np.int16 if table.dtype == np.int8 else out.dtype)


@overload(summands, strict=False)
def _typed_summands(table: Any, out: Any, n_neurons: int, n_inputs: int) -> Any:
    kind = numba.int16 if table.dtype == numba.int8 else out.dtype
    return lambda table, out, n_neurons, n_inputs: np.empty((n_neurons, n_inputs), kind)


@_kernel
def _turn_matrix(table: Array, n_rows: int, n_columns: int, column: int, width: int, out: Array) -> None:
    """Lay a block of a matrix out by neuron, (neuron, input), without the columns that pad."""
    for i in range(n_rows):
        for c in range(min(width, n_columns - column)):
            out[c, i] = table[n_rows * column + i * width + c]


@_kernel
def _add_up_block(
    trains: Array,
    n_steps: int,
    weights: Array,
    delays: Array,
    scale: float,
    z: Array,
    width: int,
    place: int,
) -> None:
    """Write the scaled, delayed sums of a block's neurons, sample after sample.

    Args:
        trains: (2, sample, word, input) uint64.
        n_steps: of a sample.
        weights: (neuron, input) of the block, int16 or of z's type; other columns become 0.
        delays: (neuron, input) int8.
        scale: factor of the sums.
        z: filled, block by block.
        width: of the block.
        place: where the block starts in z.
    """
    buffer = np.zeros(LANES * WORD, z.dtype)
    for n in range(trains.shape[1]):
        for k in range(trains.shape[2]):
            for group in range(0, width, LANES):
                for c in range(LANES):
                    if group + c < weights.shape[0]:
                        total = _sum_word(trains, n, k, weights, delays, group + c, z)
                        store(buffer, c * WORD, total * splat(scale, total))
                    else:
                        buffer[c * WORD : (c + 1) * WORD] = 0
                at = place + (n * n_steps + k * WORD) * width + group
                left = min(WORD, n_steps - k * WORD)
                whole = left - left % LANES
                for step in range(0, whole, LANES):
                    transpose(buffer, step, WORD, z, at + step * width, width)
                for step in range(whole, left):
                    for c in range(LANES):
                        z[at + step * width + c] = buffer[c * WORD + step]


@_kernel
def add_up(
    trains: Array,
    n_steps: int,
    table: Array,
    delays: Array,
    n_neurons: int,
    n_columns: int,
    scale: float,
    z: Array,
) -> None:
    """Write a layer's scaled, delayed sums.

    Args:
        trains: (2, sample, word, input) uint64.
        n_steps: of a sample.
        table: weights in blocks.
        delays: in blocks.
        n_neurons: without those that pad.
        n_columns: with them.
        scale: factor of the sums.
        z: filled, block by block.
    """
    n_samples, n_inputs = trains.shape[1], trains.shape[3]
    column = 0
    while column < n_columns:
        width = width_at(column, n_columns)
        n_filled = min(width, n_neurons - column)
        block = summands(table, z, n_filled, n_inputs)
        late = np.empty((n_filled, n_inputs), np.int8)
        _turn_matrix(table, n_inputs, n_neurons, column, width, block)
        _turn_matrix(delays, n_inputs, n_neurons, column, width, late)
        _add_up_block(trains, n_steps, block, late, scale, z, width, n_samples * n_steps * column)
        column += width


@_part
def fill_differences(of: Array, n_steps: int, out: Array) -> None:
    """Fill `out`, (sample, step), with central differences over the steps of the window."""
    for n in range(of.shape[0]):
        last = of.shape[1] - 1
        for t in range(1, min(n_steps, last)):
            out[n, t] = (of[n, t + 1] - of[n, t - 1]) * 0.5
        out[n, 0] = of[n, 1] * 0.5
        if n_steps > last:
            out[n, last] = of[n, last - 1] * -0.5


@_kernel
def add_gradients(
    trains: Array,
    by_neuron: Array,
    n_steps: int,
    weights: Array,
    delays: Array,
    n_neurons: int,
    unit: float,
    gradient: Array,
    by_delay: Array,
) -> None:
    """Add dL/dw and dL/dd of every synapse to the gradients.

    Args:
        trains: (2, input, sample, word) uint64.
        by_neuron: dL/dz, (padded neuron, sample, word * 64), as `turn` lays it out.
        n_steps: of a sample.
        weights: in blocks.
        delays: in blocks.
        n_neurons: without those that pad.
        unit: weight units per unit of the weights.
        gradient: in blocks.
        by_delay: in blocks; empty: delays are not learnt.
    """
    n_inputs, n_words = trains.shape[1], trains.shape[2] * trains.shape[3]
    n_columns = by_neuron.shape[0]
    learns = by_delay.size > 0
    difference = np.zeros(by_neuron.shape[1:], by_neuron.dtype)
    by_step, by_differences, fired = by_neuron.ravel(), difference.ravel(), trains.ravel()
    column = 0
    while column < n_columns:
        width = width_at(column, n_columns)
        for c in range(min(width, n_neurons - column)):
            if learns:
                fill_differences(by_neuron[column + c], n_steps, difference)
            start = (column + c) * n_words * WORD
            for first in range(0, n_words, TILE_WORDS):
                last = min(first + TILE_WORDS, n_words)
                for i in range(n_inputs):
                    at = n_inputs * column + i * width + c
                    delay, now, before = np.uint64(delays[at]), i * n_words, (n_inputs + i) * n_words
                    by_w, by_d = zeros(by_step, LANES_64), zeros(by_step, LANES_64)
                    for k in range(first, last):
                        arrive = _later(fired[now + k], fired[before + k], delay)
                        if arrive != np.uint64(0):
                            mask = mask_of(arrive, LANES_64)
                            by_w = select(mask, by_w + load(by_step, start + k * WORD, LANES_64), by_w)
                            if learns:
                                there = load(by_differences, k * WORD, LANES_64)
                                by_d = select(mask, by_d + there, by_d)
                    gradient[at] += summed(by_w)
                    if learns:
                        by_delay[at] += weights[at] * unit * summed(by_d)
        column += width


@_kernel
def follow_back(
    by_neuron: Array,
    n_steps: int,
    weights: Array,
    delays: Array,
    n_neurons: int,
    unit: float,
    factors: Array,
    penalty: float,
    slope: Array,
    n_inputs: int,
    shift: int,
) -> None:
    """Multiply the surrogates of the layer below by dL/ds: through the delays, and the penalty on a spike.

    Args:
        by_neuron: dL/dz of this layer, (padded neuron, sample, (word + 1) * 64), as `turn` lays it out.
        n_steps: of a sample.
        weights: of this layer, in blocks.
        delays: of this layer, in blocks.
        n_neurons: of this layer.
        unit: weight units per unit of the weights.
        factors: (sample, input) gains of the spikes.
        penalty: what a spike adds to the loss.
        slope: of the layer below, in blocks.
        n_inputs: neurons of the layer below.
        shift: steps by which this layer sees its spikes later.
    """
    n_columns, n_samples, padded_steps = by_neuron.shape
    n_rows = n_samples * n_steps
    by_step = by_neuron.ravel()
    below = n_inputs + -n_inputs % LANES
    buffer = np.zeros(WORD, by_neuron.dtype)
    first = 0
    while first < below:
        block = width_at(first, below)
        for i in range(first, min(first + block, n_inputs)):
            for n in range(n_samples):
                at = n_rows * first + n * n_steps * block + i - first
                # A spike at step t arrives at t + shift.
                for begin in range(0, n_steps, WORD):
                    total = zeros(by_step, LANES_64)
                    if begin + shift < n_steps:
                        column = 0
                        while column < n_columns:
                            width = width_at(column, n_columns)
                            for c in range(min(width, n_neurons - column)):
                                of = n_inputs * column + i * width + c
                                start = ((column + c) * n_samples + n) * padded_steps + begin + shift
                                seen = load(by_step, start + delays[of], LANES_64)
                                total = total + splat(weights[of] * unit, total) * seen
                            column += width
                    store(buffer, 0, total)
                    for t in range(begin, min(begin + WORD, n_steps)):
                        slope[at + t * block] *= buffer[t - begin] * factors[n, i] + penalty
        first += block
