"""The inner loop of pooling: one event into the pools that hold its pixel, one bin out as sorted channels.

A bin is `words` (word,), a bit per channel that has an event, and `counts` (channel,), how many, saturating
at 255; `counts` is empty where one event makes a spike.
"""

from __future__ import annotations

import numpy as np

from dse.native.compiled import compiled
from dse.native.simd import lowest_bit

MOST = 255
"""Largest count of a pool and bin."""

_ONE = np.uint64(1)


@compiled(_nrt=False)
def add(x, y, pole, pools, words, counts):  # type: ignore[no-untyped-def]
    """Count one event in every pool that holds its pixel; outside the crop that is none.

    pole: 1 for ON where polarities are split, else 0. words: (word,) uint64. counts: (channel,) uint8, or
    empty.
    """
    for j in range(pools.first_y[y], pools.first_y[y] + pools.n_y[y]):
        row = (pole * pools.height + j) * pools.width
        for c in range(row + pools.first_x[x], row + pools.first_x[x] + pools.n_x[x]):
            words[c >> 6] |= _ONE << np.uint64(c & 63)
            if len(counts) and counts[c] < MOST:
                counts[c] += 1


@compiled(_nrt=False)
def flush(needed, words, counts, channels, filled):  # type: ignore[no-untyped-def]
    """Append the channels of a bin that have enough events, in order; clear the bin; return the new end.

    words, counts: as of `add`. channels: (capacity,) int32 with room for every channel behind `filled`.
    """
    for k in range(len(words)):
        word = words[k]
        words[k] = np.uint64(0)
        while word:
            c = (k << 6) + lowest_bit(word)
            word &= word - _ONE
            if len(counts) == 0 or counts[c] >= needed:
                channels[filled] = c
                filled += 1
            if len(counts):
                counts[c] = 0
    return filled
