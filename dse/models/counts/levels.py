"""Levels in windows: the mean of the signal that spikes add up to, and how far it moved.

    level[p](t) = sum of what each spike of place p up to step t adds to it (`wiring`), 0 before the window
    mean[w, p]  = sum of level[p](t) over the steps of window w
    moved[w, p] = sum of |what a spike adds| over the spikes of p in window w

Both are shifted right by the bits at which no training sample exceeds `HELD`, and held there: integers, which
C computes as spikes come, with one multiplication per spike.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from dse.base.native.compiled import compiled
from dse.base.records import Answers, Array, Dataset, Ints, Parameters
from dse.base.registry import param
from dse.config.parts import KeyFault, Part, Written
from dse.models.counts.rate_windows import RateClassifier, window_edges

HELD = 4095
"""Largest magnitude of a mean or a movement: 12 bits and a sign."""


def wiring(dataset: Dataset) -> dict[str, Array]:
    """Return the place of each channel, and what its spike adds to the level there, both (channel,).

    Where that is not known (`Dataset.rises`), it is 1, but -1 of even planes where planes come in pairs.
    """
    positions, sign = dataset.positions, dataset.rises
    place = np.unique(positions[:, :2], axis=0, return_inverse=True)[1].ravel()
    if sign is None:
        planes = np.unique(positions[:, 2])
        is_pair = len(planes) % 2 == 0 and np.array_equal(planes, np.arange(len(planes)))
        sign = np.where(is_pair & (positions[:, 2] % 2 == 0), -1, 1)
    least = np.min_scalar_type(-1 - np.abs(sign).max())
    return {"place": place.astype(np.int32), "sign": sign.astype(least)}


def is_wired(arrays: Mapping[str, Array], n_channels: int) -> bool:
    """Return whether arrays that are read from a file can be those of `wiring`."""
    place, sign = arrays["place"], arrays["sign"]
    return (
        place.shape == sign.shape == (n_channels,)
        and sign.dtype in (np.int8, np.int16, np.int32)
        and set(place.tolist()) == set(range(int(place.max()) + 1))
    )


@dataclass(frozen=True)
class LevelReader(RateClassifier):
    """A classifier of counts in windows, or of levels."""

    reads: Literal["counts", "levels"] = param(
        "counts",
        choices=("counts", "levels"),
        doc="what of a window is read: its spikes, or of every place the mean level that spikes add up to "
        "and how far it moved; of encoder quantised that level is the signal",
    )

    def __post_init__(self) -> None:
        """Check the rules across keys."""
        if self.reads == "levels" and self.channels == "sum":
            raise ValueError("model.reads levels needs model.channels each, got sum")

    @classmethod
    def faults(cls, part: Part, space: Written) -> Iterator[KeyFault]:
        """Yield events with times of their own, which have no levels."""
        has_times = "encoder" not in space.parts and True in space.range("preprocessing", "every_event")
        if has_times and "levels" in part.range("reads"):
            yield part.fault("reads", "must be counts where preprocessing.every_event is true, got levels")

    def wiring(self, dataset: Dataset) -> Mapping[str, Array]:
        """Return what `wiring` does, and by how many bits levels are shifted; nothing for counts.

        Raises:
            ValueError: events have times of their own.
        """
        if self.reads == "counts":
            return {}
        if dataset.spikes.t_us is not None:
            raise ValueError("model.reads levels needs spikes of steps, got events with times of their own")
        wired = wiring(dataset)
        largest = int(np.abs(self._summed(dataset, dataset.train, wired)).max(initial=0))
        shift = max(largest.bit_length() - HELD.bit_length(), 0)
        return wired | {"shift": np.array(shift, np.uint8)}

    def counts(self, dataset: Dataset, samples: Array, wiring: Mapping[str, Array]) -> Array:
        """Return the counts of each window, or (n, window, 2 x place) means and movements, place by place."""
        if self.reads == "counts":
            return super().counts(dataset, samples, wiring)
        summed = self._summed(dataset, samples, wiring) >> wiring["shift"]
        return np.clip(summed, -HELD, HELD, out=summed)

    def _summed(self, dataset: Dataset, samples: Array, wired: Mapping[str, Array]) -> Ints:
        edges = window_edges(dataset.n_steps, dataset.spikes.step_ms, self.window_ms)
        n_places = int(wired["place"].max()) + 1
        sums = np.zeros((len(samples), len(edges) - 1, 2 * n_places), np.int32)
        first = np.asarray(samples, np.int64) * dataset.spikes.n_steps + dataset.start[samples]
        rows, channel = dataset.spikes.row_offsets, dataset.spikes.channel
        level = np.zeros(n_places, np.int32)
        _sum(rows, channel, first, edges, wired["place"], wired["sign"].astype(np.int32), level, sums)
        return sums

    def most(self, dataset: Dataset) -> int:
        """Return the largest magnitude of an input."""
        return super().most(dataset) if self.reads == "counts" else HELD

    def respond(self, fitted: Parameters, dataset: Dataset, samples: Array) -> Answers:
        """Answer as any classifier of counts; in C, a level costs what a place of a group of `kernels` does.

        Once per spike; per window once to begin it, and twice to shift and hold its two numbers.
        """
        answers = super().respond(fitted, dataset, samples)
        if self.reads == "counts" or not answers.program:
            return answers
        in_windows = 3 * (int(fitted.arrays["place"].max()) + 1) * fitted.arrays["lengths"]
        more = answers.program["tally_spike"] + in_windows
        return dataclasses.replace(answers, program={**answers.program, "kernel_place": more})

    def check_fitted(self, fitted: Parameters, n_outputs: int) -> None:
        """Check arrays that index others (`dse.config.contracts.Family`).

        Raises:
            ValueError: one has a wrong shape or range.
        """
        super().check_fitted(fitted, n_outputs)  # type: ignore[misc]
        if self.reads == "levels" and not (
            is_wired(fitted.arrays, fitted.n_channels) and 0 <= int(fitted.arrays["shift"]) < 32
        ):
            raise ValueError("its levels must fit its channels")


@compiled(_nrt=False)
def _sum(row_offsets, channel, first, edges, place, sign, level, sums):  # type: ignore[no-untyped-def]
    """Sum levels over the steps of windows, and |sign| over their spikes, into `sums`.

    Args:
        row_offsets: of the spikes.
        channel: of each spike.
        first: (n,) row at which the first window begins.
        edges: (window + 1,) steps.
        place: (channel,).
        sign: (channel,).
        level: (place,) int32, overwritten.
        sums: (n, window, 2 x place) int32 zeros.
    """
    for i in range(len(first)):
        level[:] = 0
        for w in range(len(edges) - 1):
            end = edges[w + 1]
            for p in range(len(level)):
                sums[i, w, 2 * p] = level[p] * (end - edges[w])
            for t in range(edges[w], end):
                for e in range(row_offsets[first[i] + t], row_offsets[first[i] + t + 1]):
                    p, rise = place[channel[e]], sign[channel[e]]
                    level[p] += rise
                    sums[i, w, 2 * p] += rise * (end - t)
                    sums[i, w, 2 * p + 1] += abs(rise)
