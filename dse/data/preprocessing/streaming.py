"""One pass over a recording's events, block by block: how long it is, and its spikes.

Blocks may end anywhere, even within a bin. Memory holds one block, one bin and the spikes. A bin is `words`
(word,), a bit per channel that has an event, and `counts` (channel,), how many, saturating at 255; `counts`
is empty where one event makes a spike.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from dse.base.native.compiled import compiled
from dse.base.native.simd import lowest_bit
from dse.base.records import Block, Bools, Ints
from dse.data.preprocessing.pools import Pooling

MOST = 255
"""Largest count of a pool and bin."""

_LATEST = np.iinfo(np.int64).max
_ONE = np.uint64(1)


@dataclass(frozen=True)
class Survey:
    """Length and onset of a recording, from one pass before it is pooled.

    first_us: time of its first event; 0 without events.
    n_bins: bins from the start of the temporal crop to its end or the last event, whichever comes first.
    onset_bin: first of them with enough events of either polarity in the crop, before pooling; -1: none.
    n_events: all events of the recording.
    """

    first_us: int
    n_bins: int
    onset_bin: int
    n_events: int


def survey(
    blocks: Iterable[Block], pooling: Pooling, onset_events: float, t0_us: int | None = None
) -> Survey:
    """Return length and onset of a recording.

    onset_events: in a bin that make the onset, > 0. t0_us: time that bins are counted from; None: the first
    event.
    """
    first_us, duration_us, n_events, onset = 0, 0, 0, -1
    needed = math.ceil(onset_events)
    recent: Ints = np.zeros(0, np.int64)  # bins of the last events in the crop, of fewer than make an onset
    for block in blocks:
        if not len(block.t_us):
            continue
        if not n_events:
            first_us = int(block.t_us[0])
        from_us = first_us if t0_us is None else t0_us
        n_events += len(block.t_us)
        duration_us = int(block.t_us[-1]) - from_us + 1
        if onset < 0:
            begin_us = from_us + pooling.start_us
            low, high = within(block.t_us, begin_us, from_us + pooling.end_us)
            t_us = block.t_us[low:high][in_crop(block, low, high, pooling)]
            recent = np.concatenate([recent, (t_us - begin_us) // pooling.bin_us])
            n = max(0, len(recent) - needed + 1)
            reached = recent[:n] == recent[len(recent) - n :]
            onset = int(recent[reached.argmax()]) if reached.any() else -1
            recent = recent[n:]
    return Survey(first_us, pooling.n_bins(duration_us), onset, n_events)


def in_crop(block: Block, low: int, high: int, pooling: Pooling) -> Bools:
    """Return which of the events low .. high - 1 lie in the spatial crop, (high - low,)."""
    x, y, columns, rows = pooling.crop
    u, v = block.x[low:high] - x, block.y[low:high] - y
    return np.asarray((u >= 0) & (u < columns) & (v >= 0) & (v < rows))


def pool(
    blocks: Iterable[Block], pooling: Pooling, t0_us: int, first_bin: int, n_bins: int
) -> tuple[Ints, Ints]:
    """Return the spikes per bin, (n_bins,) int64, and their channels, int32, sorted within each bin.

    Nothing is read after the block that reaches beyond the last bin; bins beyond the last event are empty.
    t0_us: time that bins are counted from: the first event, or the start of a simulated trial. first_bin:
    first to keep, from the start of the temporal crop.
    """
    counts = np.zeros(n_bins, dtype=np.int64)
    channels: Ints = np.empty(pooling.n_channels, dtype=np.int32)
    words = np.zeros((pooling.n_channels + 63) // 64, dtype=np.uint64)
    events = np.zeros(pooling.n_channels if pooling.counts_needed else 0, dtype=np.uint8)
    begin_us, stop_us = _span_us(pooling, t0_us, first_bin, n_bins)
    present, filled = 0, 0
    for block, e, high in _between(blocks, begin_us, stop_us):
        while e < high:
            e, present, filled = _take(
                block.t_us, block.x, block.y, block.polarity, e, high, begin_us, pooling, words, events,
                present, counts, channels, filled,
            )  # fmt: skip
            if len(channels) < filled + pooling.n_channels:
                channels = _grown(channels, filled, 2 * filled + pooling.n_channels)
    if n_bins:
        end = flush(pooling.needed, words, events, channels, filled)
        counts[present] = end - filled
        filled = end
    return without_quiet(counts, _grown(channels, filled, filled), pooling)


def _span_us(pooling: Pooling, t0_us: int, first_bin: int, n_bins: int) -> tuple[int, int]:
    """Return when bins begin and, with the temporal crop at the latest, end."""
    begin_us = t0_us + pooling.start_us + first_bin * pooling.bin_us
    return begin_us, min(t0_us + pooling.end_us, begin_us + n_bins * pooling.bin_us)


def _between(blocks: Iterable[Block], begin_us: int, stop_us: int) -> Iterator[tuple[Block, int, int]]:
    """Yield blocks, and which of their events lie in a span, first and last + 1, until one reaches beyond."""
    for block in blocks if begin_us < stop_us else ():
        yield block, *within(block.t_us, begin_us, stop_us)
        if len(block.t_us) and block.t_us[-1] >= stop_us:
            break


def without_quiet(counts: Ints, channels: Ints, pooling: Pooling) -> tuple[Ints, Ints]:
    """Return a raster without the channels whose mean rate over all its bins is below the rate floor.

    counts: (n_bins,) int64 spikes per bin. channels: int32, bin by bin.
    """
    if pooling.rate_floor_hz <= 0:
        return counts, channels
    spikes = np.bincount(channels, minlength=pooling.n_channels)
    loud = spikes * 1e6 >= pooling.rate_floor_hz * (len(counts) * pooling.bin_us)
    is_loud = loud[channels]
    until = np.concatenate([[0], np.cumsum(is_loud)])[np.cumsum(counts)]
    return np.diff(until, prepend=0).astype(np.int64), channels[is_loud]


def within(t_us: Ints, begin_us: int, stop_us: int) -> tuple[int, int]:
    """Return first and last + 1 of the events with begin <= t < stop."""
    n = len(t_us)
    if n and t_us[0] >= begin_us and t_us[-1] < stop_us:  # nearly all blocks of a stream
        return 0, n
    borders = np.array([min(begin_us, _LATEST), min(stop_us, _LATEST)], dtype=np.int64)
    low, high = np.searchsorted(t_us, borders)
    return int(low), int(high)


def _grown(channels: Ints, filled: int, capacity: int) -> Ints:
    """Return the filled channels in an array of another capacity."""
    larger = np.empty(capacity, dtype=np.int32)
    larger[:filled] = channels[:filled]
    return larger


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


@compiled()
def _take(  # type: ignore[no-untyped-def]
    t_us, x, y, polarity, e, high, begin_us, pools, words, events, present, counts, channels, filled
):
    """Count events e .. high - 1 and write the bins that they end; return the next event, bin and channel.

    It stops early where `channels` has no room for a whole bin.
    """
    n_channels = pools.poles * pools.width * pools.height
    edge_us = begin_us + (present + 1) * pools.bin_us
    while e < high:
        if t_us[e] >= edge_us:
            if len(channels) < filled + n_channels:
                break
            end = flush(pools.needed, words, events, channels, filled)
            counts[present] = end - filled
            filled = end
            present = (t_us[e] - begin_us) // pools.bin_us
            edge_us = begin_us + (present + 1) * pools.bin_us
        if pools.only < 0 or polarity[e] == pools.only:
            add(x[e], y[e], polarity[e] if pools.poles == 2 else 0, pools, words, events)
        e += 1
    return e, present, filled


def pool_events(
    blocks: Iterable[Block], pooling: Pooling, t0_us: int, first_bin: int, n_bins: int
) -> tuple[Ints, Ints, Ints]:
    """Return spikes per bin, (n_bins,) int64, and of every spike its channel and its time, both int32.

    Times are in microseconds since the start of the first bin that is kept. Spikes come in the order of the
    events; those of one event, where pools overlap, in the order of their channels. Work and memory grow with
    the spikes. `needed` and `rate_floor_hz` of the pooling are not read; other arguments are as of `pool`.

    Raises:
        ValueError: the bins last longer than int32 holds, 35 minutes.
    """
    if n_bins * pooling.bin_us > np.iinfo(np.int32).max:
        raise ValueError(
            "preprocessing.every_event must be false for windows of more than 35 minutes, got "
            f"{n_bins * pooling.bin_us / 6e7:.0f}"
        )
    begin_us, stop_us = _span_us(pooling, t0_us, first_bin, n_bins)
    channels: list[Ints] = [np.zeros(0, np.int32)]
    times_us: list[Ints] = [np.zeros(0, np.int32)]
    for block, low, high in _between(blocks, begin_us, stop_us):
        event, channel = channels_of(block, low, high, pooling)
        channels.append(channel)
        times_us.append((block.t_us[event] - begin_us).astype(np.int32))
    t_us = np.concatenate(times_us)
    counts = np.bincount(t_us // pooling.bin_us, minlength=n_bins).astype(np.int64)
    return counts, np.concatenate(channels), t_us


def channels_of(block: Block, low: int, high: int, pooling: Pooling) -> tuple[Ints, Ints]:
    """Return the event and the channel of every spike of events low .. high - 1, each (n,)."""
    x, y, polarity = block.x[low:high], block.y[low:high], block.polarity[low:high]
    columns = pooling.n_x[x].astype(np.int64)
    n_spikes = columns * pooling.n_y[y]
    if pooling.only >= 0:
        n_spikes[polarity != pooling.only] = 0
    event = np.repeat(np.arange(len(x)), n_spikes)
    number = np.arange(len(event)) - np.repeat(np.cumsum(n_spikes) - n_spikes, n_spikes)
    x, y = x[event], y[event]
    row, column = number // columns[event], number % columns[event]
    plane = polarity[event].astype(np.int64) if pooling.poles == 2 else 0
    channel = (
        (plane * pooling.height + pooling.first_y[y] + row) * pooling.width + pooling.first_x[x] + column
    )
    return low + event, np.asarray(channel, np.int32)
