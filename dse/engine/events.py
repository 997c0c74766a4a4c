"""Spikes of a batch as compressed rows: what every layer of the engine reads and writes."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from dse.base.native.compiled import compiled
from dse.base.records import Array, Bools, Ints, Spikes

ONCE = np.zeros(0, np.float32)
"""`Rows.times` where every entry is one spike."""


@dataclass(frozen=True)
class Rows:
    """Spikes of a batch; row r = sample * n_steps + step holds `index[offsets[r]:offsets[r + 1]]`.

    offsets: (n_samples * n_steps + 1,) int64.
    index: (n_spikes,) int32 input numbers, rising within a row.
    times: (n_spikes,) float32 how many equal spikes each entry stands for; empty: one each (`pooled`).
    """

    offsets: Array
    index: Array
    n_samples: int
    n_steps: int
    n_inputs: int
    times: Array = field(default_factory=lambda: ONCE)

    def per_step(self) -> Array:
        """Return the number of spikes per sample and step, (sample, step) int32."""
        return np.diff(self.offsets).reshape(self.n_samples, self.n_steps).astype(np.int32)

    def per_input(self) -> Ints:
        """Return the number of spikes per sample and input, (sample, input)."""
        sample = np.repeat(np.arange(self.n_samples), np.diff(self.offsets[:: self.n_steps]))
        place, times = sample * self.n_inputs + self.index, self.times if self.times.size else None
        counts = np.bincount(place, times, self.n_samples * self.n_inputs)
        return counts.reshape(self.n_samples, self.n_inputs).astype(np.int64)

    def listed(self, first: int = 0) -> Ints:
        """Return sample, step and input of every spike, (n_spikes, 3) int32; samples count from `first`."""
        row = np.repeat(np.arange(self.offsets.size - 1), np.diff(self.offsets))
        sample, step = np.divmod(row, self.n_steps)
        return np.stack([sample + first, step, self.index], axis=1).astype(np.int32)


@compiled()
def _cut(
    row_offsets: Array,
    channel: Array,
    stored_steps: int,
    samples: Array,
    start: Array,
    input_steps: int,
    steps_per_sample: int,
    offsets: Array,
    index: Array,
) -> None:
    """Fill `offsets`, and `index` where it is not empty, with the rows of each window."""
    position, row, write = 0, 0, index.size > 0
    offsets[0] = 0
    for n in range(samples.size):
        base = samples[n] * stored_steps + start[n]
        for source in range(base, base + input_steps):
            begin, end = row_offsets[source], row_offsets[source + 1]
            if write:
                index[position : position + end - begin] = channel[begin:end]
            position += end - begin
            for _ in range(steps_per_sample):
                row += 1
                offsets[row] = position


@compiled()
def _copied(
    offsets: Array,
    index: Array,
    times: Array,
    n_steps: int,
    n_inputs: int,
    delays: Array,
    copied_offsets: Array,
    copied_index: Array,
    copied_times: Array,
) -> None:
    """Fill the offsets, and the rest where it is not empty, with the delayed copies of each row."""
    position, write = 0, copied_index.size > 0
    copied_offsets[0] = 0
    for row in range(offsets.size - 1):
        for k in range(delays.size):
            if delays[k] > row % n_steps:
                continue
            begin, end = offsets[row - delays[k]], offsets[row - delays[k] + 1]
            if write:
                for e in range(end - begin):
                    copied_index[position + e] = index[begin + e] + k * n_inputs
                if times.size:
                    copied_times[position : position + end - begin] = times[begin:end]
            position += end - begin
        copied_offsets[row + 1] = position


def gather(
    spikes: Spikes,
    samples: Array,
    start: Array,
    n_steps: int,
    delays: tuple[int, ...] = (0,),
    steps_per_sample: int = 1,
    pool: Ints | None = None,
) -> Rows:
    """Cut windows out of stored spikes and add delayed copies of the inputs.

    A copy with delay d shows at network step t what the window held at t - d; nothing from before
    the window is seen. With k network steps per input step, spikes arrive on the first of the k.

    Args:
        spikes: stored spikes.
        samples: (n,) sample numbers.
        start: (n,) first stored step of each window.
        n_steps: window length in input steps.
        delays: delay of each copy, network steps.
        steps_per_sample: network steps per input step.
        pool: (n_channels,) number of each channel's pool, from 0: copies are of pools (`pooled`), which are
            fewer; None: of channels.

    Returns:
        Rows of n samples, n_steps * steps_per_sample steps, n_channels (or pools) * len(delays) inputs.

    Raises:
        ValueError: a window reaches outside the stored steps, or the spikes are not binary.
    """
    if spikes.t_us is not None:
        raise ValueError("preprocessing.every_event must be false for spiking networks, got true")
    samples = np.asarray(samples, np.int64)
    start = np.asarray(start, np.int64)
    if samples.size and (start.min() < 0 or start.max() + n_steps > spikes.n_steps):
        raise ValueError(
            f"windows of {n_steps} steps must lie within the {spikes.n_steps} stored steps, "
            f"got starts from {start.min()} to {start.max()}"
        )
    network_steps = n_steps * steps_per_sample
    offsets, nothing = np.empty(samples.size * network_steps + 1, np.int64), np.empty(0, np.int32)
    arguments = (spikes.row_offsets, spikes.channel, spikes.n_steps, samples, start, n_steps)
    _cut(*arguments, steps_per_sample, offsets, nothing)
    index = np.empty(offsets[-1], np.int32)
    if index.size:
        _cut(*arguments, steps_per_sample, offsets, index)
    rows = pooled(Rows(offsets, index, samples.size, network_steps, spikes.n_channels), pool)
    return rows if delays == (0,) else _delayed_copies(rows, np.asarray(delays, np.int64))


def _delayed_copies(rows: Rows, delays: Ints) -> Rows:
    offsets, nothing = np.empty_like(rows.offsets), np.empty(0, np.int32)
    arguments = (rows.offsets, rows.index, rows.times, rows.n_steps, rows.n_inputs, delays, offsets)
    _copied(*arguments, nothing, ONCE)
    index = np.empty(offsets[-1], np.int32)
    times = np.empty(index.size if rows.times.size else 0, np.float32)
    if index.size:
        _copied(*arguments, index, times)
    return replace(rows, offsets=offsets, index=index, n_inputs=rows.n_inputs * delays.size, times=times)


@compiled()
def _without(
    offsets: Array, index: Array, n_steps: int, silenced: Array, left_offsets: Array, left_index: Array
) -> int:
    """Fill the offsets and the index with what is not silenced; return the number of spikes."""
    position, n_channels = 0, silenced.shape[1]
    left_offsets[0] = 0
    for row in range(offsets.size - 1):
        of_sample = silenced[row // n_steps]
        for e in range(offsets[row], offsets[row + 1]):
            if not of_sample[index[e] % n_channels]:
                left_index[position] = index[e]
                position += 1
        left_offsets[row + 1] = position
    return position


def without(rows: Rows, silenced: Bools) -> Rows:
    """Return rows without the spikes of silenced channels, (sample, channel), and of their delayed copies."""
    offsets, index = np.empty_like(rows.offsets), np.empty_like(rows.index)
    n_left = _without(rows.offsets, rows.index, rows.n_steps, silenced, offsets, index)
    return Rows(offsets, index[:n_left], rows.n_samples, rows.n_steps, rows.n_inputs)


@compiled()
def _pooled(
    offsets: Array, index: Array, pool: Array, n_pools: int, out_offsets: Array, out: Array, times: Array
) -> int:
    """Fill the pools of each row and how many of its spikes fall into each; return the number of entries."""
    counts, position = np.zeros(n_pools, np.int32), 0
    out_offsets[0] = 0
    for row in range(offsets.size - 1):
        for e in range(offsets[row], offsets[row + 1]):
            counts[pool[index[e]]] += 1
        for k in range(n_pools):
            if counts[k]:
                out[position], times[position] = k, counts[k]
                position += 1
                counts[k] = 0
        out_offsets[row + 1] = position
    return position


def pooled(rows: Rows, pool: Ints | None) -> Rows:
    """Return rows in which inputs of one pool are one input, which counts their spikes.

    Sums over equal weights are the same in whole numbers; in floating point they run over pools.

    Args:
        rows: of single spikes.
        pool: (input,) number of each input's pool, from 0; None: each input is alone.
    """
    if pool is None:
        return rows
    n_pools = int(pool.max(initial=-1)) + 1
    most = min(rows.index.size, (rows.offsets.size - 1) * n_pools)
    offsets, index, times = np.empty_like(rows.offsets), np.empty(most, np.int32), np.empty(most, np.float32)
    n = _pooled(rows.offsets, rows.index, pool, n_pools, offsets, index, times)
    return Rows(offsets, index[:n], rows.n_samples, rows.n_steps, n_pools, times[:n])


def delayed(fired: Rows) -> Rows:
    """Return the spikes one step later, as the next layer sees them; the last step's spikes are lost."""
    n, t = fired.n_samples, fired.n_steps
    counts = fired.per_step()
    kept = np.zeros((n, t), np.int64)
    kept[:, 1:] = counts[:, :-1]
    offsets = np.concatenate([[0], np.cumsum(kept.ravel())])
    lost = np.zeros((n, t), bool)
    lost[:, -1] = True
    index = fired.index[~np.repeat(lost.ravel(), counts.ravel())]
    return Rows(offsets, index, n, t, fired.n_inputs)


def dense(rows: Rows) -> Array:
    """Return rows as a dense (sample, step, input) uint8 array: for outputs and tests, never for inputs."""
    out = np.zeros((rows.n_samples * rows.n_steps, rows.n_inputs), np.uint8)
    out[np.repeat(np.arange(len(out)), np.diff(rows.offsets)), rows.index] = 1
    return out.reshape(rows.n_samples, rows.n_steps, rows.n_inputs)
