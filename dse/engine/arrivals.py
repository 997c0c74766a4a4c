"""Delays per synapse spike by spike: the sums of dse.engine.delays for inputs that spike seldom.

The work grows with spikes times neurons, that of trains with inputs times neurons times words. Both give
the same results, bit for bit. Forward, one input's spikes reach a neuron at different steps, so that every
sum runs over inputs in their order. Backward, sums run in the 64 lanes of a word; a delay turns the lanes,
which changes no pair that `summed` adds. Forward, all inputs of a layer go one way; backward, each its own.

An input's spikes are places: step t of sample n is n * stride + t, in a stride that holds what arrives late.
"""

from __future__ import annotations

import numpy as np

from dse.base.native.compiled import compiled
from dse.base.native.simd import (
    LANES_2,
    LANES_4,
    LANES_64,
    as_type_of,
    halved,
    joined,
    load,
    splat,
    store,
    transpose,
    zeros,
)
from dse.base.records import Array
from dse.engine import kernels
from dse.engine.delays import SEGMENT, TILE_WORDS, WORD, difference, summands, words_of
from dse.engine.layout import LANES, width_at

_kernel = compiled()
_part = compiled(forceinline=True)

_SPIKES_A_WORD = 4
"""A word of a train takes as long as so many spikes, forward and backward."""
_NEURONS = 2
_LANES = 2 * _NEURONS * WORD


@_kernel
def stride_of(n_steps: int) -> int:
    """Return the places of a sample: its words, and one more."""
    return int((words_of(n_steps) + 1) * WORD)


@_kernel
def break_even(n_samples: int, n_steps: int) -> int:
    """Return how many spikes of an input in some samples take as long one by one as its trains."""
    return int(_SPIKES_A_WORD * n_samples * words_of(n_steps))


@_kernel
def by_input(
    offsets: Array, index: Array, first_row: int, n_samples: int, n_steps: int, n_inputs: int
) -> tuple[Array, Array]:
    """Return where each input's spikes start, (input + 1,), and in which rows they lie, (spike,) int32.

    Args:
        offsets: row r lists `index[offsets[r]:offsets[r + 1]]`.
        index: input numbers.
        first_row: which rows; they are counted from it.
        n_samples: of them.
        n_steps: of a sample.
        n_inputs: of the layer.
    """
    n_rows = n_samples * n_steps
    first, end = offsets[first_row], offsets[first_row + n_rows]
    starts, rows = np.empty((1, n_inputs + 1), np.int64), np.empty(end - first, np.int32)
    of_rows = offsets[first_row : first_row + n_rows + 1] - first
    once = np.empty(0, np.float32)
    starts_of_rows = np.array([0, n_rows])
    kernels.transpose(of_rows, index[first:end], once, n_inputs, starts_of_rows, starts, rows, once)
    return starts[0], rows


@_kernel
def places_of(inputs: Array, starts: Array, rows: Array, n_steps: int) -> tuple[Array, Array]:
    """Return where some inputs' spikes start, (n + 1,), and their places, rising, (spike,) int32.

    Args:
        inputs: (n,) which.
        starts: input i fires in the rows `rows[starts[i]:starts[i + 1]]`.
        rows: step t of sample n is n * n_steps + t.
        n_steps: of a sample.
    """
    begins, longer = np.zeros(inputs.size + 1, np.int64), stride_of(n_steps) - n_steps
    for x in range(inputs.size):
        begins[x + 1] = begins[x] + starts[inputs[x] + 1] - starts[inputs[x]]
    places = np.empty(begins[-1], np.int32)
    for x in range(inputs.size):
        sample, end = 0, n_steps
        for e in range(begins[x + 1] - begins[x]):
            row = rows[starts[inputs[x]] + e]
            while row >= end:
                sample, end = sample + 1, end + n_steps
            places[begins[x] + e] = row + sample * longer
    return begins, places


@_kernel
def add_up(
    starts: Array,
    places: Array,
    n_samples: int,
    n_steps: int,
    table: Array,
    delays: Array,
    n_neurons: int,
    n_columns: int,
    scale: float,
    z: Array,
) -> None:
    """Write a layer's scaled, delayed sums, as `delays.add_up` does.

    Args:
        starts: (input + 1,) of `places_of` all inputs.
        places: likewise.
        n_samples: of them.
        n_steps: of a sample.
        table: weights in blocks.
        delays: in blocks.
        n_neurons: without those that pad.
        n_columns: with them.
        scale: factor of the sums.
        z: filled, block by block.
    """
    n_inputs, stride = starts.size - 1, stride_of(n_steps)
    n_places, n_rows = n_samples * stride, n_samples * n_steps
    part = summands(table, z, 1, n_places).ravel()
    part[:] = 0
    # Rows of a power of two of bytes would all fall into one set of the cache.
    row = n_places + LANES
    sums = np.empty(LANES * row, z.dtype)
    whole = n_steps - n_steps % LANES
    for column in range(0, n_columns, LANES):
        block = column - column % WORD
        while block + width_at(block, n_columns) <= column:
            block += width_at(block, n_columns)
        width, group = width_at(block, n_columns), column - block
        sums[:] = 0
        for c in range(min(LANES, n_neurons - column)):
            for first in range(0, n_inputs, SEGMENT):
                for i in range(first, min(first + SEGMENT, n_inputs)):
                    at = n_inputs * block + i * width + group + c
                    weight, delay = part.dtype.type(table[at]), np.uint64(delays[at])
                    if weight != 0:
                        # Unsigned, or every index is looked at for its sign.
                        for e in range(np.uint64(starts[i]), np.uint64(starts[i + 1])):
                            part[np.uint64(places[e]) + delay] += weight
                for place in range(0, n_places, WORD):
                    added = as_type_of(load(part, place, LANES_64), z)
                    store(sums, c * row + place, load(sums, c * row + place, LANES_64) + added)
                    store(part, place, zeros(part, LANES_64))
            for place in range(0, n_places, WORD):
                total = load(sums, c * row + place, LANES_64)
                store(sums, c * row + place, total * splat(scale, total))
        for n in range(n_samples):
            to, here = n_rows * block + n * n_steps * width + group, n * stride
            for t in range(0, whole, LANES):
                transpose(sums, here + t, row, z, to + t * width, width)
            for t in range(whole, n_steps):
                for c in range(LANES):
                    z[to + t * width + c] = sums[c * row + here + t]


@_kernel
def _ends_of_tiles(starts: Array, places: Array, borders: Array) -> Array:
    """Return where the spikes of each input that lie before some borders end, (border, input)."""
    n_inputs = starts.size - 1
    ends = np.empty((borders.size, n_inputs), np.int64)
    for i in range(n_inputs):
        e = starts[i]
        for tile in range(borders.size):
            while e < starts[i + 1] and places[e] < borders[tile]:
                e += 1
            ends[tile, i] = e
    return ends


@_part
def _end_before(border: int, places: Array, begin: int, end: int, delay: int) -> int:
    """Return where those of some spikes end that arrive before a border."""
    while end > begin and places[end - 1] + delay >= border:
        end -= 1
    return end


@_part
def _add_one(places: Array, begin: int, end: int, pairs: Array, ahead: int, lanes: Array, first: int) -> None:
    """Add to the lanes of one neuron what it has `ahead` of each of some spikes."""
    for e in range(np.uint64(begin), np.uint64(end)):
        lane, here = first + (places[e] & (WORD - 1)) * 2 * _NEURONS, 2 * places[e] + ahead
        store(lanes, lane, load(lanes, lane, LANES_2) + load(pairs, here, LANES_2))


@_part
def _add_sums(
    lanes: Array,
    first: int,
    at: int,
    weights: Array,
    unit: float,
    gradient: Array,
    by_delay: Array,
    sums: Array,
) -> None:
    """Add the sums of two neurons' lanes to their gradients and clear the lanes; `sums` is overwritten."""
    nothing = zeros(lanes, LANES_64)
    even = load(lanes, first, LANES_64) + load(lanes, first + 2 * WORD, LANES_64)
    odd = load(lanes, first + WORD, LANES_64) + load(lanes, first + 3 * WORD, LANES_64)
    for k in range(0, _LANES, WORD):
        store(lanes, first + k, nothing)
    store(sums, 0, halved(halved(halved(halved(even + odd)))))
    for c in range(_NEURONS):
        gradient[at + c] += sums[2 * c]
        if by_delay.size > 0:
            by_delay[at + c] += weights[at + c] * unit * sums[2 * c + 1]


@_part
def _fill_pairs(of: Array, n_steps: int, axonal: bool, out: Array) -> None:
    """Fill `out`, (sample, stride, 2), with a neuron's dL/dz and its differences in the window."""
    for n in range(of.shape[0]):
        for t in range(n_steps):
            out[n, t, 0] = of[n, t]
            out[n, t, 1] = difference(of, n, t, axonal)


@_kernel
def add_gradients(
    inputs: Array,
    starts: Array,
    places: Array,
    n_inputs: int,
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
    """Add dL/dw and dL/dd of the synapses of some inputs to the gradients, as `delays.add_gradients` does.

    Args:
        inputs: (n,) which.
        starts: (n + 1,) of `places_of`.
        places: of `places_of`.
        n_inputs: of the layer.
        by_neuron: dL/dz, (padded neuron, sample, stride), as `delays.turn` lays it out.
        n_steps: of a sample.
        weights: in blocks.
        delays: in blocks.
        n_neurons: without those that pad.
        unit: weight units per unit of the weights.
        axonal: whether delays are those of axons.
        gradient: in blocks.
        by_delay: in blocks; empty: delays are not learnt.
    """
    n_columns, n_samples, stride = by_neuron.shape
    words = stride // WORD - 1
    n_words, n_places = n_samples * words, n_samples * stride
    ends_in_words = np.minimum(np.arange(TILE_WORDS, n_words + TILE_WORDS, TILE_WORDS), n_words)
    borders = ends_in_words // words * stride + ends_in_words % words * WORD
    ends = _ends_of_tiles(starts, places, borders)
    done = np.empty((_NEURONS, inputs.size), np.int64)
    # dL/dz and its difference side by side, of two neurons: a spike adds all four at once.
    pairs = np.zeros((_NEURONS, n_samples, stride, 2), by_neuron.dtype)
    of_pairs = pairs.ravel()
    # Lanes are read one input later: a load waits for stores that it overlaps.
    lanes, sums = np.zeros(2 * _LANES, by_neuron.dtype), np.empty(2 * _NEURONS, by_neuron.dtype)
    first, waiting = 0, -1
    column = 0
    while column < n_columns:
        width = width_at(column, n_columns)
        for c in range(0, min(width, n_neurons - column), _NEURONS):
            for x in range(_NEURONS):
                _fill_pairs(by_neuron[column + c + x], n_steps, axonal, pairs[x])
                done[x] = starts[:-1]
            for tile in range(borders.size):
                for i in range(inputs.size):
                    at, end = n_inputs * column + inputs[i] * width + c, ends[tile, i]
                    late_0, late_1 = np.int64(delays[at]), np.int64(delays[at + 1])
                    begin_0, begin_1 = done[0, i], done[1, i]
                    end_0 = _end_before(borders[tile], places, begin_0, end, late_0)
                    end_1 = _end_before(borders[tile], places, begin_1, end, late_1)
                    if begin_0 == end_0 and begin_1 == end_1:
                        continue
                    done[0, i], done[1, i] = end_0, end_1
                    ahead_0, ahead_1 = 2 * late_0, 2 * (late_1 + n_places)
                    # At the borders of a tile some spikes are of one neuron alone.
                    begin, end = max(begin_0, begin_1), min(end_0, end_1)
                    if begin >= end:
                        begin = end = max(end_0, end_1)
                    _add_one(places, begin_0, min(begin, end_0), of_pairs, ahead_0, lanes, first)
                    _add_one(places, begin_1, min(begin, end_1), of_pairs, ahead_1, lanes, first + 2)
                    to = np.uint64(first)
                    step_0, step_1 = np.uint64(ahead_0), np.uint64(ahead_1)
                    for e in range(np.uint64(begin), np.uint64(end)):
                        place = np.uint64(places[e])
                        lane = to + (place & np.uint64(WORD - 1)) * np.uint64(2 * _NEURONS)
                        here = place * np.uint64(2)
                        of_0 = load(of_pairs, here + step_0, LANES_2)
                        of_1 = load(of_pairs, here + step_1, LANES_2)
                        store(lanes, lane, load(lanes, lane, LANES_4) + joined(of_0, of_1))
                    _add_one(places, end, end_0, of_pairs, ahead_0, lanes, first)
                    _add_one(places, end, end_1, of_pairs, ahead_1, lanes, first + 2)
                    first = _LANES - first
                    if waiting >= 0:
                        _add_sums(lanes, first, waiting, weights, unit, gradient, by_delay, sums)
                    waiting = at
        column += width
    if waiting >= 0:
        _add_sums(lanes, _LANES - first, waiting, weights, unit, gradient, by_delay, sums)
