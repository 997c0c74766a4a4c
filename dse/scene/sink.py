"""Where the camera's events go: an event list, or the slots of a pooled raster that is written bin by bin."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dse.native.compiled import compiled
from dse.preprocessing import Pooling
from dse.preprocessing.kernels import add, flush
from dse.records import Ints

EVENTS, DROPPED, OVERFLOW, LOST, LOOKS = range(5)
"""Places in `tally`: events sent, dropped in refractory time, not stored; looks at pins outside; looks."""

N_TALLY = 5

_RADIX_BITS = 11
_RADIX = 1 << _RADIX_BITS


class Sink(NamedTuple):
    """Where events go: into an event list, or into the slots of a pooled raster.

    t_us, x, y, polarity: (capacity,) of an event list; without entries for a raster.
    words, counts: slots of bins as in preprocessing.kernels, a power of two of them.
    the rest: arrays and numbers of preprocessing.Pooling; bin b covers start_us + [b, b + 1) bin_us before
        end_us, of n_bins.
    """

    t_us: Ints
    x: Ints
    y: Ints
    polarity: Ints
    words: Ints
    counts: Ints
    first_x: Ints
    n_x: Ints
    first_y: Ints
    n_y: Ints
    pools_x: int
    pools_y: int
    poles: int
    only: int
    start_us: int
    end_us: int
    bin_us: int
    n_bins: int


class Raster(NamedTuple):
    """Arrays of a raster: spikes per bin, their channels, and how many events make one."""

    counts: Ints
    channels: Ints
    needed: int


class Written(NamedTuple):
    """How far a raster is written: its next bin, background events added, channels written."""

    bin: int
    n_background: int
    n_channels: int


class EventColumns(NamedTuple):
    """A Block as a kernel takes it."""

    t_us: Ints
    x: Ints
    y: Ints
    polarity: Ints


def list_sink(capacity: int) -> Sink:
    """Return an event list with room for so many events."""
    none = np.zeros(0, np.int32)
    return Sink(
        t_us=np.empty(capacity, np.int32),
        x=np.empty(capacity, np.int32),
        y=np.empty(capacity, np.int32),
        polarity=np.empty(capacity, np.uint8),
        words=np.zeros((1, 0), np.uint64),
        counts=np.zeros((1, 0), np.uint8),
        first_x=none,
        n_x=none,
        first_y=none,
        n_y=none,
        pools_x=0,
        pools_y=0,
        poles=1,
        only=-1,
        start_us=0,
        end_us=0,
        bin_us=1,
        n_bins=0,
    )


def raster_sink(pooling: Pooling, n_bins: int, delay_us: float) -> Sink:
    """Return the slots of a raster.

    Args:
        pooling: its pools and bins.
        n_bins: of the raster.
        delay_us: how long after its stamp an event may still be sent.
    """
    none = np.zeros(0, np.int32)
    slots = 1 << (int(np.ceil(delay_us / pooling.bin_us)) + 1).bit_length()
    n_counts = pooling.n_channels if pooling.needed > 1 else 0
    return Sink(
        t_us=none,
        x=none,
        y=none,
        polarity=np.zeros(0, np.uint8),
        words=np.zeros((slots, (pooling.n_channels + 63) // 64), np.uint64),
        counts=np.zeros((slots, n_counts), np.uint8),
        first_x=pooling.first_x,
        n_x=pooling.n_x,
        first_y=pooling.first_y,
        n_y=pooling.n_y,
        pools_x=pooling.width,
        pools_y=pooling.height,
        poles=pooling.poles,
        only=pooling.only,
        start_us=pooling.start_us,
        end_us=pooling.end_us,
        bin_us=pooling.bin_us,
        n_bins=n_bins,
    )


@compiled(forceinline=True, _nrt=False)
def store(sink, tally, x, y, pole, stamp):  # type: ignore[no-untyped-def]
    """Store an event in the list, or count it in the raster."""
    n = tally[EVENTS]
    tally[EVENTS] = n + 1
    if len(sink.t_us) == 0:
        into_raster(sink, x, y, pole, stamp)
    elif n < len(sink.t_us):
        sink.t_us[n] = stamp
        sink.x[n] = x
        sink.y[n] = y
        sink.polarity[n] = pole
    else:
        tally[OVERFLOW] += 1


@compiled(forceinline=True, _nrt=False)
def into_raster(sink, x, y, pole, stamp):  # type: ignore[no-untyped-def]
    """Count an event in the raster's slots."""
    if sink.only >= 0 and pole != sink.only:
        return
    since = stamp - sink.start_us
    if since < 0 or stamp >= sink.end_us:
        return
    b = int(since * (1.0 / sink.bin_us))  # a division costs more than the event; one off at a border
    if b * sink.bin_us > since:
        b -= 1
    elif (b + 1) * sink.bin_us <= since:
        b += 1
    if b < sink.n_bins:
        add(
            b & (len(sink.words) - 1), x, y, pole if sink.poles == 2 else 0, sink.first_x, sink.n_x,
            sink.first_y, sink.n_y, sink.pools_x, sink.pools_y, sink.words, sink.counts,
        )  # fmt: skip


@compiled(_nrt=False)
def finish_bins(sink, background, raster, tally, written, until_us):  # type: ignore[no-untyped-def]
    """Finish the bins that end by a time: add their background, append their channels; return how far.

    Args:
        sink: slots of the bins.
        background: background events, sorted by time.
        raster: counts and channels to write.
        tally: counters.
        written: how far the raster was written before.
        until_us: no event before this time is still to come.
    """
    bin, n_background, n_channels = written
    while bin < len(raster.counts):
        end_us = sink.start_us + (bin + 1) * sink.bin_us
        if end_us > until_us:
            break
        while n_background < len(background.t_us) and background.t_us[n_background] < end_us:
            into_raster(
                sink, background.x[n_background], background.y[n_background],
                background.polarity[n_background], background.t_us[n_background],
            )  # fmt: skip
            n_background += 1
        if n_channels + sink.words.shape[1] * 64 > len(raster.channels):
            tally[OVERFLOW] += 1
            n_channels = 0
        end = flush(
            bin & (len(sink.words) - 1), raster.needed, sink.words, sink.counts, raster.channels, n_channels
        )
        raster.counts[bin] = end - n_channels
        n_channels = end
        bin += 1
    return Written(bin, n_background, n_channels)


@compiled()
def order_of(t, y, x, p):  # type: ignore[no-untyped-def]
    """Return the order of events by time, row, column and polarity; times are not negative."""
    n = len(t)
    order, other = np.arange(n), np.empty(n, np.int64)
    most = t.max() if n else 0
    shift = 0
    while most >> shift:
        ends = np.zeros(_RADIX + 1, np.int64)
        for i in range(n):
            ends[((t[i] >> shift) & (_RADIX - 1)) + 1] += 1
        ends = np.cumsum(ends)
        for k in range(n):
            i = order[k]
            digit = (t[i] >> shift) & (_RADIX - 1)
            other[ends[digit]] = i
            ends[digit] += 1
        order, other = other, order
        shift += _RADIX_BITS
    for k in range(1, n):  # ties are few and short
        i, at = order[k], k
        while at > 0:
            j = order[at - 1]
            if t[j] != t[i] or (y[j], x[j], p[j]) <= (y[i], x[i], p[i]):
                break
            order[at] = j
            at -= 1
        order[at] = i
    return order
