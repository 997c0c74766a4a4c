"""Windows that training changes before it learns from them: joined, stretched, moved, thinned."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product

import numpy as np

from dse.base.native.compiled import compiled
from dse.base.records import Array, Bools, Floats, Ints, Spikes


@dataclass(frozen=True)
class Windows:
    """Windows of stored spikes, and the steps that they may show, all int64.

    samples: (n,) sample numbers.
    start: (n,) first step.
    low, end: (n,) first step that may be shown, and the one after the last.
    """

    samples: Ints
    start: Ints
    low: Ints
    end: Ints


@dataclass(frozen=True)
class Shifts:
    """Where the spikes of every channel go when the array is moved.

    to: (shift, channel) int32 channels, -1: nowhere; the first shift is none.
    keeps_order: (shift,) whether channels rise where they rose before.
    """

    to: Ints
    keeps_order: Bools


def shifts_of(positions: Ints, most: int) -> Shifts:
    """Return all shifts by pairs of up to `most` places along x and along y.

    Places are numbered along an axis in the order of its coordinates, so that a pitch of any size is one
    place. What leaves the array is lost. Channels that are alone in their plane stay where they are.

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
    to = np.full((len(shifts), n), -1, np.int32)
    for row, (dx, dy) in zip(to, shifts, strict=True):
        row[:] = [at.get((a + dx, b + dy, p), -1) for a, b, p in zip(x, y, plane, strict=True)]
    to = np.where(alone, np.arange(n, dtype=np.int32), to)
    return Shifts(to, np.array([(np.diff(row[row >= 0]) > 0).all() for row in to]))


_kernel = compiled(_nrt=False)


@_kernel
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


@_kernel
def _changed(
    row_offsets: Array,
    channel: Array,
    stored_steps: int,
    windows: Array,
    cut: Array,
    factor: Array,
    moved: Array,
    shifts: Array,
    keeps_order: Array,
    dice: Array,
    lowest: int,
    n_steps: int,
    offsets: Array,
    index: Array,
) -> int:
    """Fill the offsets and the index of `changed`; windows are (2, 4, n) sample, start, low, end."""
    position, read, row, centre = 0, 0, 0, n_steps / 2
    offsets[0] = 0
    for n in range(cut.size):
        shift, stretch = moved[n], factor[n]
        edge = math.ceil((0 - centre) / stretch + centre - 0.5)
        for part in range(2):
            sample, start, low, end = (
                windows[part, 0, n] * stored_steps,
                windows[part, 1, n],
                windows[part, 2, n],
                windows[part, 3, n],
            )
            for t in range(cut[n] if part else 0, n_steps if part else cut[n]):
                after = t + 1 if stretch == 1 else math.ceil((t + 1 - centre) / stretch + centre - 0.5)
                from_step = min(max(start + edge, low), end)
                to_step = min(max(start + after, low), end)
                edge, begin = after, position
                first, last = row_offsets[sample + from_step], row_offsets[sample + to_step]
                if shift:
                    for e in range(first, last):
                        to = shifts[shift, channel[e]]
                        index[position] = to
                        position += 1 if to >= 0 and (lowest == 0 or dice[read + e - first] >= lowest) else 0
                elif lowest > 0:
                    for e in range(first, last):
                        index[position] = channel[e]
                        position += 1 if dice[read + e - first] >= lowest else 0
                else:
                    for k in range(last - first):
                        index[position + k] = channel[first + k]
                    position += last - first
                read += last - first
                if to_step > from_step + 1 or (shift and not keeps_order[shift]):
                    position = _once(index, begin, position)
                row += 1
                offsets[row] = position
    return position


def changed(
    spikes: Spikes,
    windows: Windows,
    others: Windows,
    cut: Ints,
    factor: Floats,
    moved: Ints,
    shifts: Shifts,
    n_steps: int,
    dropped: float,
    rng: np.random.Generator,
) -> Spikes:
    """Return windows as samples of their own: joined with others, stretched, moved and thinned.

    Sample i shows window i up to step cut[i] and the other one from there. Stretched by f about the middle c
    of the window, a spike at step s is seen at floor(c + f (s + 1/2 - c)); two spikes of a channel that fall
    into one step are one. Steps that a window may not show are silent.

    Args:
        spikes: stored spikes, binary.
        windows: n of them.
        others: n of them.
        cut: (n,) int64 steps; n_steps everywhere: the others are not shown.
        factor: (n,) float64 by which times are stretched, > 0.
        moved: (n,) int64 number of each one's shift.
        shifts: of the array.
        n_steps: length of the windows.
        dropped: probability with which each spike is dropped, to 1/65536.
        rng: draws which.
    """
    is_joined = bool((cut < n_steps).any())
    most = _most_shown(spikes, windows) + (_most_shown(spikes, others) if is_joined else 0)
    lowest = round(dropped * 2**16)
    dice = rng.bit_generator.random_raw(-(-most // 4) if lowest else 0).view(np.uint16)
    offsets, index = np.empty(len(cut) * n_steps + 1, np.int64), np.empty(most + 1, np.int32)
    n_spikes = _changed(
        spikes.row_offsets,
        spikes.channel,
        spikes.n_steps,
        np.stack([(w.samples, w.start, w.low, w.end) for w in (windows, others)]),
        cut,
        factor,
        moved,
        shifts.to,
        shifts.keeps_order,
        dice,
        lowest,
        n_steps,
        offsets,
        index,
    )
    return Spikes(offsets, index[:n_spikes], n_steps, spikes.n_channels, spikes.step_ms)


def _most_shown(spikes: Spikes, windows: Windows) -> int:
    """Return how many spikes some windows may show."""
    row = windows.samples * spikes.n_steps
    return int((spikes.row_offsets[row + windows.end] - spikes.row_offsets[row + windows.low]).sum())
