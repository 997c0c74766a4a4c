"""Events in, spikes out: bins of time, pools of space, one pass over the events.

    count[b, p, j, i] = number of events of polarity p with  b = floor((t - t_0) / bin)  and address (x, y) in
                        pool (i, j):  i stride <= x < i stride + kernel,  j stride <= y < j stride + kernel
    spike[b, p, j, i] = 1 where count >= pool_threshold

t_0 is the recording's first event, so that the wait for it tells nothing. Along an axis shorter than the
kernel the kernel is that axis (a row of taxels is pooled along x alone); pools that would stick out are
left out. Spike channel (p height + j) width + i of the pooled frame; p is 0 for OFF and 1 for ON where
polarities are split, else 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from dse.records import Array, Events, Spikes
from dse.registry import param

POLARITIES = ("split", "merge", "ignore_off")


@dataclass(frozen=True)
class Preprocessing:
    """How event recordings become spikes."""

    bin_ms: float = param(doc="width of a time bin: one step", unit="ms", low=0.001)
    pool: int = param(1, doc="side of the square pooling kernel", unit="pixels", low=1)
    stride: int | None = param(None, doc="distance of pools; absent: the kernel's side", unit="pixels", low=1)
    pool_threshold: int = param(1, doc="events in a pool and bin that make a spike", low=1)
    polarity: str = param("split", doc="ON and OFF apart, together, or ON alone", choices=POLARITIES)

    @property
    def bin_us(self) -> int:
        """Width of a bin in whole microseconds."""
        return round(self.bin_ms * 1000)


def pooled(size: int, settings: Preprocessing) -> tuple[int, int, int]:
    """Return number, kernel and stride of the pools along an axis of `size` addresses."""
    kernel = min(settings.pool, size)
    stride = settings.stride or settings.pool
    return (size - kernel) // stride + 1, kernel, stride


def n_bins(events: Events, settings: Preprocessing) -> Array:
    """Return (n,) bins from the first to the last event of every recording."""
    first, last = events.t_us[events.offsets[:-1]], events.t_us[events.offsets[1:] - 1]
    return np.asarray((last - first) // settings.bin_us + 1)


def event_onset(events: Events, settings: Preprocessing, threshold: float) -> Array:
    """Return (n,) the first bin with at least `threshold` events, before pooling, or -1."""
    found = np.full(events.n_recordings, -1, dtype=np.int64)
    for i in range(events.n_recordings):
        t_us = events.t_us[events.offsets[i] : events.offsets[i + 1]]
        bins, counts = np.unique((t_us - t_us[0]) // settings.bin_us, return_counts=True)
        enough = counts >= threshold
        if enough.any():
            found[i] = bins[enough.argmax()]
    return found


def spikes_of(events: Events, settings: Preprocessing, first: Array, length: Array) -> Spikes:
    """Return the spikes of bins first[i] .. first[i] + length[i] - 1 of every recording.

    Args:
        events: the recordings.
        settings: bins, pools and polarity.
        first: (n,) first bin to keep.
        length: (n,) bins to keep; shorter ones end in empty rows.
    """
    x_pools, y_pools = pooled(events.width, settings), pooled(events.height, settings)
    n_channels = x_pools[0] * y_pools[0] * (2 if settings.polarity == "split" else 1)
    n_steps = int(np.max(length))
    counts = np.zeros((events.n_recordings, n_steps), dtype=np.int64)
    pieces = []
    for i in range(events.n_recordings):
        part = slice(events.offsets[i], events.offsets[i + 1])
        bins = (events.t_us[part] - events.t_us[part.start]) // settings.bin_us - first[i]
        inside = (bins >= 0) & (bins < length[i])
        if settings.polarity == "ignore_off":
            inside &= events.polarity[part] == 1
        pole = events.polarity[part] if settings.polarity == "split" else np.zeros(len(bins), dtype=np.uint8)
        pieces.append(
            _pool(
                bins[inside], events.x[part][inside], events.y[part][inside], pole[inside],
                x_pools, y_pools, n_channels, settings.pool_threshold, counts[i],
            )
        )  # fmt: skip
    offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    return Spikes(offsets, np.concatenate(pieces), n_steps, n_channels, settings.bin_us / 1000)


@numba.njit(cache=True)
def _pool(bins, x, y, pole, x_pools, y_pools, n_channels, threshold, counts):  # type: ignore[no-untyped-def]
    """Return the channels of the spikes, bin by bin in order, and write how many per bin to counts."""
    n_x, kernel_x, stride_x = x_pools
    n_y, kernel_y, stride_y = y_pools
    reach = ((kernel_x - 1) // stride_x + 1) * ((kernel_y - 1) // stride_y + 1)
    channels = np.empty(len(bins) * reach, dtype=np.int32)
    count = np.zeros(n_channels, dtype=np.int32)
    touched = np.empty(n_channels, dtype=np.int32)
    filled = 0
    e = 0
    while e < len(bins):
        present, n_touched, before = bins[e], 0, filled
        while e < len(bins) and bins[e] == present:
            # Pools i with i stride <= x <= i stride + kernel - 1.
            low_i = max(0, (x[e] - kernel_x) // stride_x + 1)
            low_j = max(0, (y[e] - kernel_y) // stride_y + 1)
            for j in range(low_j, min(n_y - 1, y[e] // stride_y) + 1):
                for i in range(low_i, min(n_x - 1, x[e] // stride_x) + 1):
                    c = (pole[e] * n_y + j) * n_x + i
                    if count[c] == 0:
                        touched[n_touched] = c
                        n_touched += 1
                    count[c] += 1
            e += 1
        for c in np.sort(touched[:n_touched]):
            if count[c] >= threshold:
                channels[filled] = c
                filled += 1
            count[c] = 0
        counts[present] = filled - before
    return channels[:filled].copy()
