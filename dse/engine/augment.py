"""Windows that training changes before it learns from them: joined, stretched, moved over the array, thinned.

Every function takes what was drawn and returns spikes; nothing here draws but `thinned`.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from itertools import product

import numpy as np

from dse.native.compiled import compiled
from dse.records import Array, Floats, Ints, Spikes


@dataclass(frozen=True)
class Windows:
    """Windows of stored spikes, and the steps that they may show.

    samples: (n,) sample numbers.
    start: (n,) first step.
    low, end: (n,) first step that may be shown, and the one after the last.
    """

    samples: Ints
    start: Ints
    low: Ints
    end: Ints


def shift_table(positions: Ints, most: int) -> Ints:
    """Return where the spikes of every channel go when the array is moved, (shift, channel); -1: nowhere.

    Shifts are all pairs of up to `most` places along x and along y, none first. Places are numbered along an
    axis in the order of its coordinates, so that a pitch of any size is one place. What leaves the array is
    lost. Channels that are alone in their plane stay where they are.

    Args:
        positions: (channel, 3) x, y and plane.
        most: places.
    """
    n = len(positions)
    x, y, plane = (np.unique(column, return_inverse=True)[1] for column in np.asarray(positions).T)
    at = {place: channel for channel, place in enumerate(zip(x, y, plane, strict=True))}
    alone = np.bincount(plane, minlength=1)[plane] == 1
    reach = range(-most, most + 1)
    along = [reach if n and axis.max() else (0,) for axis in (x, y)]
    shifts = sorted(product(*along), key=lambda shift: shift != (0, 0))
    table = np.full((len(shifts), n), -1, np.int32)
    for row, (dx, dy) in zip(table, shifts, strict=True):
        row[:] = [at.get((a + dx, b + dy, p), -1) for a, b, p in zip(x, y, plane, strict=True)]
    return np.where(alone, np.arange(n, dtype=np.int32), table)


@compiled()
def _once(index: Array, begin: int, end: int) -> int:
    """Sort a part of an index, without duplicates; return where it ends."""
    for i in range(begin + 1, end):
        value, j = index[i], i
        while j > begin and index[j - 1] > value:
            index[j] = index[j - 1]
            j -= 1
        index[j] = value
    left = begin
    for i in range(begin, end):
        if left == begin or index[i] != index[left - 1]:
            index[left] = index[i]
            left += 1
    return left


@compiled()
def _changed(
    row_offsets: Array,
    channel: Array,
    stored_steps: int,
    windows: Array,
    others: Array,
    cut: Array,
    factor: Array,
    moved: Array,
    table: Array,
    n_steps: int,
    offsets: Array,
    index: Array,
) -> int:
    """Fill the offsets and the index of `changed`; windows are (n, 4) sample, start, low, end."""
    position, centre = 0, n_steps / 2
    offsets[0] = 0
    for n in range(len(windows)):
        for t in range(n_steps):
            window = windows[n] if t < cut[n] else others[n]
            first = window[1] + math.ceil((t - centre) / factor[n] + centre - 0.5)
            last = window[1] + math.ceil((t + 1 - centre) / factor[n] + centre - 0.5)
            begin = position
            for step in range(max(first, window[2]), min(last, window[3])):
                row = window[0] * stored_steps + step
                for e in range(row_offsets[row], row_offsets[row + 1]):
                    to = table[moved[n], channel[e]]
                    if to >= 0:
                        index[position] = to
                        position += 1
            if last > first + 1 or moved[n] != 0:
                position = _once(index, begin, position)
            offsets[n * n_steps + t + 1] = position
    return position


def changed(
    spikes: Spikes,
    windows: Windows,
    others: Windows,
    cut: Ints,
    factor: Floats,
    moved: Ints,
    table: Ints,
    n_steps: int,
) -> Spikes:
    """Return windows as samples of their own, joined with others, stretched and moved.

    Sample i shows window i up to step cut[i] and the other one from there. Stretched by f about the middle c
    of the window, a spike at step s is seen at floor(c + f (s + 1/2 - c)); two spikes of a channel that fall
    into one step are one. Steps that a window may not show are silent.

    Args:
        spikes: stored spikes, binary.
        windows: n of them.
        others: n of them.
        cut: (n,) steps.
        factor: (n,) by which times are stretched, > 0.
        moved: (n,) rows of the table.
        table: of `shift_table`.
        n_steps: length of the windows.
    """

    def stacked(w: Windows) -> Ints:
        return np.stack([w.samples, w.start, w.low, w.end], axis=1).astype(np.int64)

    offsets = np.empty(len(cut) * n_steps + 1, np.int64)
    most = _most_spikes(spikes, windows) + _most_spikes(spikes, others) * bool((cut < n_steps).any())
    index = np.empty(most, np.int32)
    n_spikes = _changed(
        spikes.row_offsets,
        spikes.channel,
        spikes.n_steps,
        stacked(windows),
        stacked(others),
        np.asarray(cut, np.int64),
        np.asarray(factor, np.float64),
        np.asarray(moved, np.int64),
        table,
        n_steps,
        offsets,
        index,
    )
    return Spikes(offsets, index[:n_spikes], n_steps, spikes.n_channels, spikes.step_ms)


def _most_spikes(spikes: Spikes, windows: Windows) -> int:
    """Return how many spikes some windows can show."""
    first = windows.samples.astype(np.int64) * spikes.n_steps
    return int((spikes.row_offsets[first + windows.end] - spikes.row_offsets[first + windows.low]).sum())


def thinned(spikes: Spikes, share: float, rng: np.random.Generator) -> Spikes:
    """Return spikes of which each was dropped with the same probability."""
    kept = rng.random(len(spikes.channel), np.float32) >= share
    before = np.concatenate([[0], np.cumsum(kept)])
    return dataclasses.replace(spikes, row_offsets=before[spikes.row_offsets], channel=spikes.channel[kept])
