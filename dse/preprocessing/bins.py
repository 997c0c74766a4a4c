"""Pooling of events as they arrive: a bin is done when a later event, or the time, has passed its end.

The bins of a recording are those of `pool` and `pool_events`; memory holds the events of one of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from dse.preprocessing.pools import Pooling
from dse.preprocessing.streaming import in_crop, pool, pool_events, within
from dse.records import Block, Ints


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
        self._pooling, self._pool = pooling, pool_events if every_event else pool
        self._t0_us = self._passed_us = t0_us  # all before the latter is known
        self._blocks: list[Block] = []  # events from the present bin on
        self._n_done = 0

    def push(self, block: Block) -> Iterator[Bin]:
        """Yield the bins that some events end; the time of events never falls."""
        if len(block.t_us):
            self._blocks.append(block)
            yield from self.advance(int(block.t_us[-1]), int(block.t_us[0]))
            self._passed_us = int(block.t_us[-1]) + 1

    def advance(self, t_us: int, first_us: int | None = None) -> Iterator[Bin]:
        """Yield the bins that have ended at a time before which all events are known.

        Where nothing came before, bins are counted from `first_us`, or else from this time.
        """
        if self._t0_us is None:
            self._t0_us = t_us if first_us is None else first_us
        while (ends := self._span_us)[0] < ends[1] <= t_us:
            yield self._done()
        self._blocks = [block for block in self._blocks if block.t_us[-1] >= self._span_us[0]]
        self._passed_us = t_us

    def end(self) -> Iterator[Bin]:
        """Yield the last bin, if something of it has passed."""
        if self._passed_us is not None and self._span_us[0] < min(self._passed_us, self._span_us[1]):
            yield self._done()

    @property
    def _span_us(self) -> tuple[int, int]:
        """Begin and end of the present bin, which ends with the temporal crop; behind it, none is left."""
        begin_us = (self._t0_us or 0) + self._pooling.start_us + self._n_done * self._pooling.bin_us
        return begin_us, min(begin_us + self._pooling.bin_us, (self._t0_us or 0) + self._pooling.end_us)

    def _done(self) -> Bin:
        """Return the present bin, and begin the next."""
        spans = [(block, *within(block.t_us, *self._span_us)) for block in self._blocks]
        n_events = sum(int(in_crop(block, low, high, self._pooling).sum()) for block, low, high in spans)
        found = self._pool(self._blocks, self._pooling, self._t0_us or 0, self._n_done, 1)
        self._n_done += 1
        return Bin(found[1], found[2] if len(found) > 2 else None, n_events)
