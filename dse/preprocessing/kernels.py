"""The inner loop of pooling: one event into the pools that hold its pixel, one bin out as sorted channels.

A bin is a slot of `words` (slot, word), a bit per channel that has an event, and of `counts` (slot, channel),
how many, saturating at 255; `counts` has no columns where one event makes a spike. Scenes and event files
share these functions, so that a simulated raster is bit for bit the pooled event list.
"""

from __future__ import annotations

import numpy as np

from dse.native.compiled import compiled
from dse.native.simd import lowest_bit

MOST = 255
"""Largest count of a pool and bin."""

_ONE = np.uint64(1)


@compiled(_nrt=False)
def add(slot, x, y, pole, first_x, n_x, first_y, n_y, width, height, words, counts):  # type: ignore[no-untyped-def]
    """Count one event in every pool that holds its pixel; outside the crop that is none.

    Args:
        slot: the bin's slot.
        x: column of the pixel.
        y: row of the pixel.
        pole: 1 for ON where polarities are split, else 0.
        first_x: (column,) first pool of a column, along x.
        n_x: (column,) number of its pools.
        first_y: (row,) the same along y.
        n_y: (row,) the same along y.
        width: pools along x.
        height: pools along y.
        words: (slot, word) uint64.
        counts: (slot, channel) uint8, or without columns.
    """
    for j in range(first_y[y], first_y[y] + n_y[y]):
        row = (pole * height + j) * width
        for c in range(row + first_x[x], row + first_x[x] + n_x[x]):
            words[slot, c >> 6] |= _ONE << np.uint64(c & 63)
            if counts.shape[1] and counts[slot, c] < MOST:
                counts[slot, c] += 1


@compiled(_nrt=False)
def flush(slot, needed, words, counts, channels, filled):  # type: ignore[no-untyped-def]
    """Append the channels of a bin that have enough events, in order; clear the slot; return the new end.

    Args:
        slot: the bin's slot.
        needed: events that make a spike.
        words: (slot, word) uint64.
        counts: (slot, channel) uint8, or without columns.
        channels: (capacity,) int32 with room for every channel behind `filled`.
        filled: channels written so far.
    """
    for k in range(words.shape[1]):
        word = words[slot, k]
        words[slot, k] = np.uint64(0)
        while word:
            c = (k << 6) + lowest_bit(word)
            word &= word - _ONE
            if counts.shape[1]:
                if counts[slot, c] >= needed:
                    channels[filled] = c
                    filled += 1
                counts[slot, c] = 0
            else:
                channels[filled] = c
                filled += 1
    return filled
