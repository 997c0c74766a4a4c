"""Every event as a spike of the pools that hold its pixel, at its own time."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from dse.preprocessing.pools import Pooling
from dse.preprocessing.streaming import within
from dse.records import Block, Ints


def pool_events(
    blocks: Iterable[Block], pooling: Pooling, t0_us: int, first_bin: int, n_bins: int
) -> tuple[Ints, Ints, Ints]:
    """Return spikes per bin, (n_bins,) int64, and of every spike its channel and its time, both int32.

    Times are in microseconds since the start of the first bin that is kept. Spikes come in the order of the
    events; those of one event, where pools overlap, in the order of their channels. Nothing is read after the
    block that reaches beyond the last bin. Work and memory grow with the spikes.

    Args:
        blocks: events of one recording; time never falls.
        pooling: settings on its frame; `needed` and `rate_floor_hz` are not read.
        t0_us: time that bins are counted from: the first event, or the start of a simulated trial.
        first_bin: first bin to keep, from the start of the temporal crop.
        n_bins: bins to keep.

    Raises:
        ValueError: the bins last longer than int32 holds, 35 minutes.
    """
    if n_bins * pooling.bin_us > np.iinfo(np.int32).max:
        raise ValueError(
            "preprocessing.every_event must be false for windows of more than 35 minutes, got "
            f"{n_bins * pooling.bin_us / 6e7:.0f}"
        )
    begin_us = t0_us + pooling.start_us + first_bin * pooling.bin_us
    stop_us = min(t0_us + pooling.end_us, begin_us + n_bins * pooling.bin_us)
    channels: list[Ints] = [np.zeros(0, np.int32)]
    times_us: list[Ints] = [np.zeros(0, np.int32)]
    for block in blocks if n_bins else ():
        low, high = within(block.t_us, begin_us, stop_us)
        event, channel = channels_of(block, low, high, pooling)
        channels.append(channel)
        times_us.append((block.t_us[event] - begin_us).astype(np.int32))
        if len(block.t_us) and block.t_us[-1] >= stop_us:
            break
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
