"""Delays per synapse spike by spike: the sums of dse.engine.delays for layers whose inputs spike seldom.

The work grows with spikes times neurons, that of trains with inputs times neurons times words. Both give
the same results, bit for bit. Forward, one input's spikes reach a neuron at different steps, so that every
sum runs over inputs in their order. Backward, sums run in the 64 lanes of a word; a delay turns the lanes,
which changes no pair that `summed` adds.

An input's spikes are places: step t of sample n is n * stride + t, in a stride that holds what arrives late.
"""

from __future__ import annotations

import numpy as np

from dse.engine import kernels
from dse.engine.delays import SEGMENT, TILE_WORDS, WORD, fill_differences, summands, words_of
from dse.engine.layout import LANES, width_at
from dse.native.compiled import compiled
from dse.native.simd import LANES_2, LANES_64, as_type_of, halved, load, splat, store, transpose, zeros
from dse.records import Array

_kernel = compiled()

_SPIKES_A_WORD = 5
"""A word of a train takes as long as so many spikes, forward and backward."""


@_kernel
def stride_of(n_steps: int) -> int:
    """Return the places of a sample: its words, and one more."""
    return int((words_of(n_steps) + 1) * WORD)


@_kernel
def are_few(n_spikes: int, n_inputs: int, n_samples: int, n_steps: int) -> bool:
    """Return whether some samples' spikes take less time one by one than as trains."""
    return bool(n_spikes < _SPIKES_A_WORD * n_inputs * n_samples * words_of(n_steps))


@_kernel
def by_input(
    offsets: Array, index: Array, first_row: int, n_samples: int, n_steps: int, n_inputs: int
) -> tuple[Array, Array]:
    """Return where each input's spikes start, (input + 1,), and their places, rising, (spike,) int32.

    Args:
        offsets: row r lists `index[offsets[r]:offsets[r + 1]]`.
        index: input numbers.
        first_row: which rows.
        n_samples: of them.
        n_steps: of a sample.
        n_inputs: of the layer.
    """
    n_rows, stride = n_samples * n_steps, stride_of(n_steps)
    first, end = offsets[first_row], offsets[first_row + n_rows]
    starts, places = np.empty((1, n_inputs + 1), np.int64), np.empty(end - first, np.int32)
    of_rows = offsets[first_row : first_row + n_rows + 1] - first
    kernels.transpose(of_rows, index[first:end], n_inputs, np.array([0, n_rows]), starts, places)
    for e in range(places.size):
        places[e] += places[e] // n_steps * (stride - n_steps)
    return starts[0], places


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
        starts: (input + 1,) of `by_input`.
        places: of `by_input`.
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


@_kernel
def add_gradients(
    starts: Array,
    places: Array,
    by_neuron: Array,
    n_steps: int,
    weights: Array,
    delays: Array,
    n_neurons: int,
    unit: float,
    gradient: Array,
    by_delay: Array,
) -> None:
    """Add dL/dw and dL/dd of every synapse to the gradients, as `delays.add_gradients` does.

    Args:
        starts: (input + 1,) of `by_input`.
        places: of `by_input`.
        by_neuron: dL/dz, (padded neuron, sample, stride), as `delays.turn` lays it out.
        n_steps: of a sample.
        weights: in blocks.
        delays: in blocks.
        n_neurons: without those that pad.
        unit: weight units per unit of the weights.
        gradient: in blocks.
        by_delay: in blocks; empty: delays are not learnt.
    """
    n_inputs, learns = starts.size - 1, by_delay.size > 0
    n_columns, n_samples, stride = by_neuron.shape
    words = stride // WORD - 1
    n_words = n_samples * words
    ends_in_words = np.minimum(np.arange(TILE_WORDS, n_words + TILE_WORDS, TILE_WORDS), n_words)
    borders = ends_in_words // words * stride + ends_in_words % words * WORD
    ends = _ends_of_tiles(starts, places, borders)
    done = np.empty(n_inputs, np.int64)
    difference = np.zeros((n_samples, stride), by_neuron.dtype)
    # dL/dz and its difference side by side: a spike adds both at once.
    pairs = np.zeros((n_samples, stride, 2), by_neuron.dtype)
    of_pairs = pairs.ravel()
    lanes, both = np.zeros(2 * WORD, by_neuron.dtype), np.zeros(2, by_neuron.dtype)
    nothing = zeros(lanes, LANES_64)
    column = 0
    while column < n_columns:
        width = width_at(column, n_columns)
        for c in range(min(width, n_neurons - column)):
            pairs[:, :, 0] = by_neuron[column + c]
            if learns:
                fill_differences(by_neuron[column + c], n_steps, difference)
                pairs[:, :, 1] = difference
            done[:] = starts[:-1]
            for tile in range(borders.size):
                for i in range(n_inputs):
                    at = n_inputs * column + i * width + c
                    delay, begin, end = np.int64(delays[at]), done[i], ends[tile, i]
                    while end > begin and places[end - 1] + delay >= borders[tile]:
                        end -= 1
                    if begin == end:
                        continue
                    done[i] = end
                    store(lanes, 0, nothing)
                    store(lanes, WORD, nothing)
                    for e in range(np.uint64(begin), np.uint64(end)):
                        lane, here = 2 * places[e] & (2 * WORD - 1), 2 * (places[e] + delay)
                        store(lanes, lane, load(lanes, lane, LANES_2) + load(of_pairs, here, LANES_2))
                    total = load(lanes, 0, LANES_64) + load(lanes, WORD, LANES_64)
                    store(both, 0, halved(halved(halved(halved(halved(total))))))
                    gradient[at] += both[0]
                    if learns:
                        by_delay[at] += weights[at] * unit * both[1]
        column += width
