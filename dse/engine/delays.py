"""Delays per synapse: weighted sums over spikes that arrive later, and their gradients.

A spike of input i at step t reaches neuron j at step t + d_ij; beyond the window it is lost:

    z_j[t] = sum over i of w_ij s_i[t - d_ij]

With g_j[t] = dL/dz_j[t], which is 0 outside the window:

    dL/dw_ij   = sum over t of s_i[t] g_j[t + d_ij]
    dL/dd_ij   = w_ij sum over t of s_i[t] (g_j[t + d_ij + 1] - g_j[t + d_ij - 1]) / 2
    dL/ds_i[t] = sum over j of w_ij g_j[t + d_ij]

The second, over the spikes that arrive, is the central difference over whole delays; a delay is learnt as a
real number and runs rounded, straight through (Hammouamri et al. 2024 interpolate; REFERENCES.md).

An axon's delay is one delay that all synapses of an input share, d_ij = d_i. It runs rounded down, and its
gradient is the forward difference, as in SLAYER (lava-dl; REFERENCES.md):

    dL/dd_i    = sum over j, t of w_ij s_i[t] (g_j[t + d_i + 1] - g_j[t + d_i])

A delay that differs from neuron to neuron spoils every vector of neurons, so vectors run along time here: the
spikes of an input are a train of bits, 64 steps a word, and a delay shifts eight words at once. Inputs with
few spikes a word are faster in dse.engine.arrivals.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from dse.base.native.compiled import compiled, overload
from dse.base.native.simd import (
    LANES_8,
    LANES_64,
    as_type_of,
    fma,
    load,
    mask_of,
    select,
    splat,
    store,
    summed,
    transpose,
    zeros,
)
from dse.base.records import Array
from dse.engine.layout import LANES, aligned, packed, width_at
from dse.engine.parameters import Parameters, Tied
from dse.engine.shared import copies_of

MOST = 62
"""Longest delay, network steps: what 6 bits hold on Loihi, whose 63 is taken."""

_kernel = compiled()
_part = compiled(forceinline=True)

WORD = 64
GROUP = 8  # words that are delayed at once
SEGMENT = 256  # an int16 holds the sum of 256 int8 weights
TILE_WORDS = 32  # of a neuron's dL/dz and its differences: 16 KiB of float32, half of a first-level cache


@dataclass(frozen=True)
class Delays:
    """Delays of a layer's synapses in training, in blocks.

    table: int8, as they run.
    axons: which delays are one of an axon; None: each synapse has its own.
    """

    n_rows: int
    gradient: Array
    table: Array
    parameters: Parameters
    axons: Tied | None = None

    @classmethod
    def of(cls, masters: Array, longest: int, kind: Any, axonal: bool = False) -> Delays:
        """Return delays at their start, (input, neuron), which stay in [0, longest]; gradients of a type."""
        n_rows, limits = len(masters), (1.0, 0.0, float(longest))
        if not axonal:
            own = Parameters.of(masters, 1.0, None, kind, *limits)
            return cls(n_rows, own.gradient, own.table, own)
        once = Parameters.of(np.append(masters[:, 0], 0)[None], 1.0, None, kind, *limits)
        # Columns that pad hold 0, which is no axon where numbers count from 1.
        number = np.broadcast_to(np.arange(1, n_rows + 1)[:, None], masters.shape)
        axons = Tied(copies_of(packed(number, np.int32) - 1))
        table = packed(running(masters, axonal), np.int8)
        return cls(n_rows, aligned(table.size, kind), table, once, axons)

    def update(self, learning_rate: float, steps: int) -> None:
        """Take Adam's step `steps`, from 1, and round anew."""
        own = self.parameters
        if self.axons is not None:
            self.axons.pull([own.values], self.gradient, [own.gradient])
            self.gradient[:] = 0
        own.update(1.0, learning_rate, steps)
        self._run_anew()

    def _run_anew(self) -> None:
        if self.axons is not None:
            self.axons.expand([running(self.parameters.values, True).astype(np.int8)], self.table)

    def state(self) -> dict[str, Array]:
        """Return a copy of what an update reads and writes."""
        return self.parameters.state()

    def restore(self, state: Mapping[str, Array]) -> None:
        """Take over the numbers of a state."""
        self.parameters.restored(state)
        self._run_anew()


def running(masters: Array, axonal: bool) -> Array:
    """Return delays as they run: those of synapses rounded, those of axons rounded down."""
    return np.asarray(np.floor(masters) if axonal else np.rint(masters))


@_part
def words_of(n_steps: int) -> int:
    """Return the words of 64 steps that a sample takes."""
    return (n_steps + WORD - 1) // WORD


@_kernel
def trains_of(
    offsets: Array, index: Array, first_row: int, n_samples: int, n_steps: int, n_inputs: int
) -> Array:
    """Return some samples' spikes as trains, (group, input, 2, 8) uint64: words, and 63 steps before them.

    Word k of sample n is number n * words + k, eight to a group; its bit b is step 64 k + b.

    Args:
        offsets: row r lists `index[offsets[r]:offsets[r + 1]]`.
        index: input numbers.
        first_row: which rows.
        n_samples: of them.
        n_steps: of a sample.
        n_inputs: of the layer.
    """
    words = words_of(n_steps)
    n_groups = (n_samples * words + GROUP - 1) // GROUP
    out = np.zeros((n_groups, n_inputs, 2, GROUP), np.uint64)
    for n in range(n_samples):
        for t in range(n_steps):
            row, bit = first_row + n * n_steps + t, np.uint64(1) << np.uint64(t % WORD)
            word = n * words + t // WORD
            for e in range(offsets[row], offsets[row + 1]):
                out[word // GROUP, index[e], 0, word % GROUP] |= bit
    for word in range(n_samples * words):
        if word % words:
            last = word - 1
            for i in range(n_inputs):
                before = out[last // GROUP, i, 0, last % GROUP] >> np.uint64(1)
                out[word // GROUP, i, 1, word % GROUP] = before
    return out


@_part
def _delay_group(trains: Array, at: int, delay: Any, out: Array, to: int) -> None:
    """Write a group of an input's words, from `at` on in `trains`, as it arrives."""
    now, before = load(trains, at, LANES_8), load(trains, at + GROUP, LANES_8)
    late, early = splat(delay, now), splat(np.uint64(WORD - 1) - delay, now)
    store(out, to, (now << late) | (before >> early))


@_kernel
def turn(blocks: Array, n_samples: int, n_steps: int, out: Array) -> None:
    """Lay dL/dz out by neuron.

    Args:
        blocks: columns in blocks (dse.engine.layout).
        n_samples: of it.
        n_steps: of a sample.
        out: (padded neuron, sample, step), filled; steps beyond n_steps become 0.
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
                for c in range(LANES):
                    row = to + c * n_samples * steps
                    for t in range(whole, n_steps):
                        flat[row + t] = blocks[at + t * width + c]
                    flat[row + n_steps : row + steps] = 0
        column += width


def summands(table: Array, out: Array, n_neurons: int, n_inputs: int) -> Array:
    """Return an empty matrix for the weights of a table as they are summed: int16 for int8, else `out`'s."""
    return np.empty((n_neurons, n_inputs), np.int16 if table.dtype == np.int8 else out.dtype)


@overload(summands)
def _typed_summands(table: Any, out: Any, n_neurons: int, n_inputs: int) -> Any:
    import numba

    kind = numba.int16 if table.dtype == numba.int8 else out.dtype
    return lambda table, out, n_neurons, n_inputs: np.empty((n_neurons, n_inputs), kind)


@_kernel
def _turn_matrix(table: Array, n_rows: int, n_columns: int, column: int, width: int, out: Array) -> None:
    """Lay a block of a matrix out by neuron, (neuron, input), without the columns that pad."""
    for i in range(n_rows):
        for c in range(min(width, n_columns - column)):
            out[c, i] = table[n_rows * column + i * width + c]


@_part
def _add_four_words(arrivals: Array, k: int, weights: Array, at: int, n: int, sums: Array, to: int) -> None:
    """Add the weights of n inputs, from `at` on, to the steps of words k to k + 3 in which they arrive."""
    nothing = zeros(weights, LANES_64)
    first, second, third, fourth = nothing, nothing, nothing, nothing
    for i in range(np.uint64(n)):  # unsigned, or every index is looked at for its sign
        weight, here = splat(weights[at + i], nothing), i * np.uint64(GROUP) + np.uint64(k)
        first = select(mask_of(arrivals[here], LANES_64), first + weight, first)
        second = select(mask_of(arrivals[here + np.uint64(1)], LANES_64), second + weight, second)
        third = select(mask_of(arrivals[here + np.uint64(2)], LANES_64), third + weight, third)
        fourth = select(mask_of(arrivals[here + np.uint64(3)], LANES_64), fourth + weight, fourth)
    _add_to(sums, to, first)
    _add_to(sums, to + WORD, second)
    _add_to(sums, to + 2 * WORD, third)
    _add_to(sums, to + 3 * WORD, fourth)


@_part
def _add_to(sums: Array, at: int, added: Any) -> None:
    store(sums, at, load(sums, at, LANES_64) + as_type_of(added, sums))


@_kernel
def add_up(
    trains: Array,
    n_samples: int,
    n_steps: int,
    table: Array,
    delays: Array,
    n_neurons: int,
    n_columns: int,
    scale: float,
    z: Array,
) -> None:
    """Write a layer's scaled, delayed sums; int8 weights sum exactly.

    Args:
        trains: (group, input, 2, 8) uint64.
        n_samples: of them.
        n_steps: of a sample.
        table: weights in blocks.
        delays: in blocks.
        n_neurons: without those that pad.
        n_columns: with them.
        scale: factor of the sums.
        z: filled, block by block.
    """
    n_inputs, words = trains.shape[1], words_of(n_steps)
    n_rows, fired = n_samples * n_steps, trains.ravel()
    arrive = np.empty(SEGMENT * GROUP, np.uint64)
    # Rows of a power of two of bytes would all fall into one set of the cache.
    row = GROUP * WORD + LANES
    sums = np.empty(LANES * row, z.dtype)
    column = 0
    while column < n_columns:
        width = width_at(column, n_columns)
        n_filled = min(width, n_neurons - column)
        block = summands(table, z, n_filled, n_inputs)
        late = np.empty((n_filled, n_inputs), np.int8)
        _turn_matrix(table, n_inputs, n_neurons, column, width, block)
        _turn_matrix(delays, n_inputs, n_neurons, column, width, late)
        weights = block.ravel()
        for number in range(trains.shape[0]):
            for group in range(0, width, LANES):
                sums[:] = 0
                for c in range(min(LANES, n_filled - group)):
                    for first in range(0, n_inputs, SEGMENT):
                        n = min(SEGMENT, n_inputs - first)
                        for i in range(n):
                            delay = np.uint64(late[group + c, first + i])
                            at = 2 * GROUP * (number * n_inputs + first + i)
                            _delay_group(fired, at, delay, arrive, GROUP * i)
                        at = np.uint64((group + c) * n_inputs + first)
                        for k in range(0, GROUP, 4):
                            _add_four_words(arrive, k, weights, at, n, sums, c * row + k * WORD)
                    for k in range(GROUP):
                        total = load(sums, c * row + k * WORD, LANES_64)
                        store(sums, c * row + k * WORD, total * splat(scale, total))
                for k in range(min(GROUP, n_samples * words - GROUP * number)):
                    n, word = (GROUP * number + k) // words, (GROUP * number + k) % words
                    at = n_rows * column + (n * n_steps + word * WORD) * width + group
                    left = min(WORD, n_steps - word * WORD)
                    whole = left - left % LANES
                    for step in range(0, whole, LANES):
                        transpose(sums, k * WORD + step, row, z, at + step * width, width)
                    for step in range(whole, left):
                        for c in range(LANES):
                            z[at + step * width + c] = sums[c * row + k * WORD + step]
        column += width


@_part
def difference(of: Array, n: int, t: int, axonal: bool) -> Any:
    """Return how a neuron's dL/dz changes at a step: the central difference, of axons the forward one."""
    if axonal:
        return of[n, t + 1] - of[n, t]
    return of[n, 1] * 0.5 if t == 0 else (of[n, t + 1] - of[n, t - 1]) * 0.5


@_part
def _fill_differences(of: Array, n_steps: int, axonal: bool, out: Array) -> None:
    """Fill `out`, (sample, stride), with a neuron's differences in the window; `of` is 0 beyond."""
    for n in range(of.shape[0]):
        for t in range(n_steps):
            out[n, t] = difference(of, n, t, axonal)


@_part
def _add_sums(
    by_w: Any, by_d: Any, at: int, weights: Array, unit: float, gradient: Array, by_delay: Array
) -> None:
    gradient[at] += summed(by_w)
    if by_delay.size > 0:
        by_delay[at] += weights[at] * unit * summed(by_d)


@_kernel
def add_gradients(
    inputs: Array,
    trains: Array,
    by_neuron: Array,
    n_steps: int,
    weights: Array,
    delays: Array,
    n_neurons: int,
    unit: float,
    axonal: bool,
    gradient: Array,
    by_delay: Array,
) -> None:
    """Add dL/dw and dL/dd of the synapses of some inputs to the gradients.

    Three inputs at a time share what is read of dL/dz.

    Args:
        inputs: (n,) which.
        trains: (group, input, 2, 8) uint64.
        by_neuron: dL/dz, (padded neuron, sample, stride), as `turn` lays it out.
        n_steps: of a sample.
        weights: in blocks.
        delays: in blocks.
        n_neurons: without those that pad.
        unit: weight units per unit of the weights.
        axonal: whether delays are those of axons.
        gradient: in blocks.
        by_delay: in blocks; empty: delays are not learnt.
    """
    n_inputs, words = trains.shape[1], words_of(n_steps)
    n_columns, n_samples, stride = by_neuron.shape
    n_words = n_samples * words
    differences = np.zeros(by_neuron.shape[1:], by_neuron.dtype)
    by_step, by_differences, fired = by_neuron.ravel(), differences.ravel(), trains.ravel()
    places = np.arange(n_words) // words * stride + np.arange(n_words) % words * WORD
    arrive = np.empty(3 * TILE_WORDS, np.uint64)
    second, third = np.uint64(TILE_WORDS), np.uint64(2 * TILE_WORDS)
    nothing = zeros(by_step, LANES_64)
    # x * 1 + y is x + y to the bit, and other ports of the processor compute it.
    one = splat(1.0 if n_steps > 0 else 0.0, nothing)
    column = 0
    while column < n_columns:
        width = width_at(column, n_columns)
        for c in range(min(width, n_neurons - column)):
            _fill_differences(by_neuron[column + c], n_steps, axonal, differences)
            start = (column + c) * n_samples * stride
            for first in range(0, n_words, TILE_WORDS):
                n = min(TILE_WORDS, n_words - first)
                for at_once in range(0, inputs.size, 3):
                    some = min(3, inputs.size - at_once)
                    for x in range(some):
                        i = inputs[at_once + x]
                        delay = np.uint64(delays[n_inputs * column + i * width + c])
                        for k in range(0, n, GROUP):
                            at = 2 * GROUP * ((first + k) // GROUP * n_inputs + i)
                            _delay_group(fired, at, delay, arrive, TILE_WORDS * x + k)
                    w_0, w_1, w_2, d_0, d_1, d_2 = nothing, nothing, nothing, nothing, nothing, nothing
                    for k in range(np.uint64(n)):
                        mask_0 = mask_of(arrive[k], LANES_64)
                        mask_1 = mask_of(arrive[k + second], LANES_64)
                        mask_2 = mask_of(arrive[k + third], LANES_64)
                        place = places[np.uint64(first) + k]
                        there = load(by_step, start + place, LANES_64)
                        w_0 = select(mask_0, w_0 + there, w_0)
                        w_1 = select(mask_1, w_1 + there, w_1)
                        w_2 = select(mask_2, w_2 + there, w_2)
                        difference_there = load(by_differences, place, LANES_64)
                        d_0 = select(mask_0, fma(difference_there, one, d_0), d_0)
                        d_1 = select(mask_1, fma(difference_there, one, d_1), d_1)
                        d_2 = select(mask_2, fma(difference_there, one, d_2), d_2)
                    at = n_inputs * column + c
                    _add_sums(w_0, d_0, at + inputs[at_once] * width, weights, unit, gradient, by_delay)
                    if some > 1:
                        i = inputs[at_once + 1]
                        _add_sums(w_1, d_1, at + i * width, weights, unit, gradient, by_delay)
                    if some > 2:
                        i = inputs[at_once + 2]
                        _add_sums(w_2, d_2, at + i * width, weights, unit, gradient, by_delay)
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
