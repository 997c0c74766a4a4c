"""Pooling of events as they arrive: a bin is done when a later event, or the time, has passed its end.

The bins of a recording are those of `pool` and `pool_events`; memory holds one of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from dse.base.native.compiled import compiled
from dse.base.records import Block, Ints
from dse.data.preprocessing.pools import Pooling
from dse.data.preprocessing.streaming import add, channels_of, flush, within


class Bin(NamedTuple):
    """A bin that is done.

    channels: int32, rising; with `every_event`, one of each spike, in the order of their times.
    t_us: int32 times of the spikes since the start of the bin, with `every_event`; else None.
    n_events: events of either polarity in the crop, before pooling.
    """

    channels: Ints
    t_us: Ints | None
    n_events: int


class Bins:
    """The bins of one recording that has no end.

    Args:
        pooling: settings on its frame, without a rate floor.
        every_event: whether each event is a spike of its own.
        t0_us: time that bins are counted from; None: the first event.

    Raises:
        ValueError: the pooling has a rate floor, which needs the whole recording.
    """

    def __init__(self, pooling: Pooling, every_event: bool = False, t0_us: int | None = None) -> None:
        if pooling.rate_floor_hz > 0:
            raise ValueError("preprocessing.rate_floor_hz needs whole recordings and cannot run bin by bin")
        self._pooling, self._every_event = pooling, every_event
        n = pooling.n_channels
        self._words = np.zeros((n + 63) // 64, np.uint64)
        self._counts = np.zeros(n if pooling.counts_needed else 0, np.uint8)
        self._channels = np.empty(n, np.int32)
        self._spikes: list[tuple[Ints, Ints]] = []
        self._n_events = 0
        self._end_us = 0  # of the present bin
        self._passed_us: int | None = None  # all before is known
        if t0_us is not None:
            self._start(t0_us)

    def push(self, block: Block) -> Iterator[Bin]:
        """Yield the bins that some events end; the time of events never falls."""
        if not len(block.t_us):
            return
        if self._passed_us is None:
            self._start(int(block.t_us[0]))
        low, until = within(block.t_us, self._start_us, self._stop_us)
        while low < until:
            if block.t_us[low] >= self._end_us:
                yield self._done()
                continue
            low = self._add(block, low, until)
        last_us = int(block.t_us[-1])
        if last_us >= self._end_us or last_us >= self._stop_us:
            yield from self._skip_to(last_us)
        self._passed_us = last_us + 1

    def advance(self, t_us: int) -> Iterator[Bin]:
        """Yield the bins that have ended at a time before which all events are known."""
        if self._passed_us is None:
            self._start(t_us)
        yield from self._skip_to(t_us)
        self._passed_us = t_us

    def end(self) -> Iterator[Bin]:
        """Yield the last bin, if something of it has passed."""
        if self._passed_us is not None and self._begin_us < min(self._passed_us, self._stop_us):
            yield self._done()

    @property
    def _begin_us(self) -> int:
        return self._end_us - self._pooling.bin_us

    def _start(self, t0_us: int) -> None:
        self._start_us, self._stop_us = t0_us + self._pooling.start_us, t0_us + self._pooling.end_us
        self._end_us = self._start_us + self._pooling.bin_us
        self._passed_us = t0_us

    def _skip_to(self, t_us: int) -> Iterator[Bin]:
        """Yield the bins that have ended at a time, the last one at the end of the temporal crop."""
        while self._begin_us < self._stop_us and min(self._end_us, self._stop_us) <= t_us:
            yield self._done()

    def _add(self, block: Block, low: int, until: int) -> int:
        """Count events of the present bin; return the first that is of a later one."""
        events, bins = (block.t_us, block.x, block.y, block.polarity), (self._words, self._counts)
        end, in_crop = _count(*events, low, until, self._end_us, self._pooling, *bins)
        if self._every_event:
            event, channels = channels_of(block, low, end, self._pooling)
            t_us = block.t_us[event] - self._begin_us
            self._spikes.append((channels, t_us.astype(np.int32)))
        self._n_events += in_crop
        return int(end)

    def _done(self) -> Bin:
        """Return the present bin, and begin the next."""
        n = flush(self._pooling.needed, self._words, self._counts, self._channels, 0)
        done = Bin(self._channels[:n].copy(), None, self._n_events)
        if self._every_event:
            none = np.zeros(0, np.int32)
            channels, t_us = zip(*self._spikes, (none, none), strict=True)
            done = Bin(np.concatenate(channels), np.concatenate(t_us), self._n_events)
            self._spikes.clear()
        self._n_events = 0
        self._end_us += self._pooling.bin_us
        return done


@compiled()
def _count(  # type: ignore[no-untyped-def]
    t_us, x, y, polarity, e, high, end_us, pools, words, counts
):
    """Count the events before `end_us` in their pools; return the next event and how many lay in the crop."""
    in_crop, (left, top, columns, rows) = 0, pools.crop
    while e < high and t_us[e] < end_us:
        if 0 <= x[e] - left < columns and 0 <= y[e] - top < rows:
            in_crop += 1
        if pools.only < 0 or polarity[e] == pools.only:
            add(x[e], y[e], polarity[e] if pools.poles == 2 else 0, pools, words, counts)
        e += 1
    return e, in_crop
