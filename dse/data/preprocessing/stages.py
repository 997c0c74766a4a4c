"""One event recording at every stage of preprocessing: as recorded, cropped, pooled, cut to its window."""

from __future__ import annotations

from dataclasses import dataclass

from dse.base.records import Block, Ints


@dataclass(frozen=True)
class Stages:
    """One event recording at every stage; times count from its first event, or the start of its simulation.

    name: what it is a recording of.
    events: all of them, times included.
    frame: width and height. crop: x, y, width and height of the pixels that are kept.
    counts, channels: pooled spikes of the whole recording: per bin, (bin,) int64, and the channel of each.
    n_channels: of the pooled frame. bin_us: width of a bin.
    begin_us, end_us: the window that a classifier receives.
    """

    name: str
    events: Block
    frame: tuple[int, int]
    crop: tuple[int, int, int, int]
    counts: Ints
    channels: Ints
    n_channels: int
    bin_us: int
    begin_us: int
    end_us: int
