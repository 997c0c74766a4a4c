"""Rep(T): spikes counted in consecutive windows, and what classifiers of such counts share.

    Rep(w) = sum over channels n of the spikes of n in window w             (channels: sum, as printed)
    Rep(n, w) = spikes of n in window w                                     (channels: each)

A step belongs to the window in which it begins; the last window may be shorter and is counted as it is. What
is counted are spikes, of which a channel has one per step. With `preprocessing.every_event` every event
counts, in the window that its own microsecond lies in, whatever the steps.
Source: [Brayshaw et al., temporal and spatio-temporal domains in REFERENCES.md], Eq. (1).
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, ClassVar, Literal

import numpy as np

from dse.base.native.compiled import compiled
from dse.base.native.threads import single_threaded
from dse.base.records import Answers, Array, Dataset, Ints, Outcome, Parameters, Spikes
from dse.base.registry import fixed, param
from dse.models.training import Generators, Training

Channels = Literal["sum", "each"]

_STEPS = 1 << 22  # of samples that are looked at together
_ON_BORDER = 1e-9  # of a window: a step that begins so close before a border begins on it


def window_edges(n_steps: int, step_ms: float, window_ms: float) -> Array:
    """Return the first step of every window, and `n_steps`, as (window + 1,) int64.

    Step t begins at t step_ms and lies in window floor(t step_ms / window_ms).

    Raises:
        ValueError: windows are shorter than a step.
    """
    per_step = step_ms / window_ms
    if per_step > 1 + _ON_BORDER:
        raise ValueError(f"window_ms must be >= the step of {step_ms:g} ms, got {window_ms:g}")
    window = np.floor(np.arange(n_steps) * per_step + _ON_BORDER)
    return np.append(np.flatnonzero(np.diff(window, prepend=-1)), n_steps).astype(np.int64)


def window_counts(
    spikes: Spikes, samples: Array, start: Array, edges: Array, channels: Channels | Ints
) -> Array:
    """Return how many spikes fall into each window, (n, window, channel) int32; one channel for 'sum'.

    The work grows with the spikes, and for 'sum' with the windows only.

    Args:
        spikes: stored spikes.
        samples: (n,) sample numbers.
        start: (n,) stored step at which the first window of each begins.
        edges: (window + 1,) of `window_edges`.
        channels: 'sum' counts the spikes of all channels together; (n_channels,) the group of each, from 0:
            those of a group together.

    Raises:
        ValueError: a window reaches outside the stored steps.
    """
    samples, start = np.asarray(samples, np.int64), np.asarray(start, np.int64)
    if samples.size and (start.min() < 0 or start.max() + edges[-1] > spikes.n_steps):
        raise ValueError(
            f"windows of {edges[-1]} steps must lie within the {spikes.n_steps} stored steps, "
            f"got starts from {start.min()} to {start.max()}"
        )
    return _counted(spikes, spikes.row_offsets[(samples * spikes.n_steps + start)[:, None] + edges], channels)


def most_spikes(edges: Sequence[int], n_channels: int) -> int:
    """Return the most spikes of channels that count together in a window of `window_edges`."""
    return max(end - begin for begin, end in pairwise(edges)) * n_channels


def event_edges_us(duration_us: int, window_ms: float) -> Array:
    """Return the first microsecond of every window, and `duration_us`, as (window + 1,) int64."""
    window_us = round(1000 * window_ms)
    if window_us < 1:
        raise ValueError(f"window_ms must be >= 0.001, got {window_ms:g}")
    return np.append(np.arange(0, duration_us, window_us), duration_us).astype(np.int64)


def event_counts(
    spikes: Spikes, samples: Array, start: Array, edges_us: Array, channels: Channels | Ints
) -> Array:
    """Return how many events fall into each window, as `window_counts` does for spikes without times.

    Args:
        spikes: stored events (`Spikes.t_us`).
        samples: (n,) sample numbers.
        start: (n,) stored step at which the first window of each begins.
        edges_us: (window + 1,) of `event_edges_us`; the windows end with a step.
        channels: as of `window_counts`.
    """
    assert spikes.t_us is not None
    step_us = round(1000 * spikes.step_ms)
    borders = np.empty((len(samples), len(edges_us)), np.int64)
    for k, (i, first) in enumerate(zip(samples, start, strict=True)):
        row = int(i) * spikes.n_steps + int(first)
        begin, end = spikes.row_offsets[[row, row + int(edges_us[-1]) // step_us]]
        borders[k] = begin + np.searchsorted(spikes.t_us[begin:end], edges_us + int(first) * step_us)
    return _counted(spikes, borders, channels)


def _counted(spikes: Spikes, borders: Array, channels: Channels | Ints) -> Array:
    """Return how many spikes lie between borders, (n, window + 1), by channel or group, or of all."""
    if isinstance(channels, str) and channels == "sum":
        return np.asarray(np.diff(borders, axis=1).astype(np.int32)[:, :, None])
    group = np.arange(spikes.n_channels) if isinstance(channels, str) else channels
    counts = np.zeros((len(borders), borders.shape[1] - 1, int(group.max(initial=-1)) + 1), np.int32)
    _count(borders, spikes.channel, group, counts)
    return counts


@compiled(_nrt=False)
def _count(borders: Array, channel: Array, group: Array, counts: Array) -> None:
    """Count the spikes `borders[n, w]` to `borders[n, w + 1]` by the group of their channel."""
    for n in range(counts.shape[0]):
        for w in range(counts.shape[1]):
            for e in range(borders[n, w], borders[n, w + 1]):
                counts[n, w, group[channel[e]]] += 1


def as_features(counts: Array) -> Array:
    """Return counts (n, window, channel) as (n, feature); the features of a shorter input come first."""
    return counts.reshape(len(counts), counts.shape[1] * counts.shape[2])


def input_lengths(n_windows: int, most: int) -> Array:
    """Return input lengths in windows, (k,) int64 rising to `n_windows`: all, or `most` evenly spaced."""
    k = min(n_windows, most)
    return -(-np.arange(1, k + 1) * n_windows // k)


def tallied(dataset: Dataset, samples: Array, steps: Array, n_features: Array) -> dict[str, Array]:
    """Return what a program does to count spikes, by kind of work, (k,) means over samples.

    Args:
        dataset: of the samples.
        samples: (n,) numbers of samples.
        steps: (k,) steps until each answer.
        n_features: (k,) counts that it looks at.
    """
    spikes = dataset.spikes
    first = samples * spikes.n_steps + dataset.start[samples]
    n_spikes = n_busy = np.zeros(len(steps))
    for part in np.array_split(first, max(1, first.size * int(steps[-1]) // _STEPS)):
        offsets = spikes.row_offsets[part[:, None] + np.arange(steps[-1] + 1)]
        busy = (np.diff(offsets, axis=1) > 0).sum(axis=0).cumsum()
        n_spikes = n_spikes + (offsets[:, steps] - offsets[:, :1]).sum(axis=0)
        n_busy = n_busy + busy[steps - 1]
    n = max(1, len(samples))
    return {
        "tally_start": np.ones(len(steps)),
        "tally_step": steps.astype(np.float64),
        "tally_spike": n_spikes / n,
        "tally_add": n_spikes / n,
        "tally_word": -(-spikes.n_channels // 32) * n_busy / n,
        "tally_count": n_features.astype(np.float64),
    }


@dataclass(frozen=True)
class Learnt:
    """What training left: arrays for inference, epoch curves, health."""

    arrays: Mapping[str, Array]
    history: Mapping[str, Array] = field(default_factory=dict)
    health: Mapping[str, Any] = field(default_factory=dict)


class Windowed(ABC):
    """A classifier of what spikes add up to in windows; every input length has a readout of its own.

    A subclass is a frozen dataclass with the keys `window_ms` and `read_outs`. Training sees the evaluated
    window of `dataset.train`.
    """

    takes_events: ClassVar[bool] = True

    window_ms: float
    read_outs: int

    def wiring(self, dataset: Dataset) -> Mapping[str, Array]:
        """Return arrays that say how channels add up; they are stored with what is learnt."""
        return {}

    @abstractmethod
    def counts(self, dataset: Dataset, samples: Array, wiring: Mapping[str, Array]) -> Array:
        """Return what spikes add up to in each window, (n, window, number) int32."""

    @abstractmethod
    def most(self, dataset: Dataset) -> int:
        """Return what no input of a readout can exceed, whatever a recording holds."""

    @abstractmethod
    def learn(self, counts: Array, target: Array, lengths: Array, most: int, rngs: Generators) -> Learnt:
        """Train one readout per input length.

        Args:
            counts: (n, window, number) int32 of the training samples, n >= 1.
            target: (n,) class of each; classes may be missing.
            lengths: (k,) windows that each readout sees.
            most: as of `most`; of events with times of their own, which it does not bound, the largest.
            rngs: random generators by purpose.
        """

    @abstractmethod
    def label(self, arrays: Mapping[str, Array], counts: Array, lengths: Array) -> Array:
        """Return the class of each sample after each input length, (n, k) int64; see `learn`."""

    def program(
        self, arrays: Mapping[str, Array], counts: Array, lengths: Array
    ) -> Mapping[str, Array | list[float]]:
        """Return how often its C does each kind of work, (k,) means over samples; empty if there is no C.

        Arguments as of `label`; kinds are those of `dse.measure.hardware.kinds.processor`, but for counting
        itself.
        """
        return {}

    def stored_bits(self, arrays: Mapping[str, Array]) -> int | None:
        """Return the bits that its C takes per stored number; None if there is no C."""
        return None

    @abstractmethod
    def n_weights(self, arrays: Mapping[str, Array], n_features: Array) -> Array:
        """Return the stored numbers W_t of each length's readout, (k,), given its input features, (k,)."""

    def operations(self, arrays: Mapping[str, Array], n_features: Array) -> tuple[Array, Array | float]:
        """Return multiply-accumulates per inference, (k,), and additions beside one per input spike.

        Unless a family says otherwise, every stored number is multiplied once, and nothing more is added.
        """
        return self.n_weights(arrays, n_features).astype(np.float64), 0.0

    def fit(self, dataset: Dataset, training: Training, rngs: Generators) -> Outcome:
        """Train on `dataset.train`; answer on validation and, where there is one, on test.

        Args:
            dataset: spikes of any kind, targets and split.
            training: not used; a family of counts has its own settings.
            rngs: random generators by purpose.

        Raises:
            ValueError: there is no training sample, or windows are shorter than a step.
        """
        if not dataset.train.size:
            raise ValueError("training needs at least one training sample, got none")
        begin_s = time.perf_counter()
        wiring = self.wiring(dataset)
        counts = self.counts(dataset, dataset.train, wiring)
        lengths = input_lengths(counts.shape[1], self.read_outs)
        most = self.most(dataset) if dataset.spikes.t_us is None else int(counts.max(initial=0))
        with single_threaded():
            learnt = self.learn(counts, dataset.target[dataset.train], lengths, most, rngs)
        train_s = time.perf_counter() - begin_s
        fitted = Parameters({**learnt.arrays, **wiring, "lengths": lengths}, dataset.spikes.n_channels)
        return Outcome(
            fitted,
            self.respond(fitted, dataset, dataset.validation),
            self.respond(fitted, dataset, dataset.test) if dataset.test.size else None,
            learnt.history,
            learnt.health,
            train_s,
        )

    def respond(self, fitted: Parameters, dataset: Dataset, samples: Array) -> Answers:
        """Answer after every input length that was trained.

        Raises:
            ValueError: the data set has other channels or another number of windows than was trained on.
        """
        lengths = fitted.arrays["lengths"]
        ends_ms = self._ends_ms(dataset)
        shape = dataset.spikes.n_channels, len(ends_ms)
        if shape != (fitted.n_channels, lengths[-1]):
            raise ValueError(
                f"samples must have {fitted.n_channels} channels and {lengths[-1]} windows of "
                f"{self.window_ms:g} ms as in training, got {shape[0]} and {shape[1]}"
            )
        counts = self.counts(dataset, samples, fitted.arrays)
        of_all = self.counted(dataset, samples, "sum")[:, :, 0]
        input_spikes = of_all.cumsum(axis=1, dtype=np.int64)[:, lengths - 1]
        n_features = lengths * counts.shape[2]
        macs, more = self.operations(fitted.arrays, n_features)
        program: dict[str, Array] = {}
        with single_threaded():
            label = self.label(fitted.arrays, counts, lengths)
            answering = self.program(fitted.arrays, counts, lengths) if dataset.spikes.t_us is None else {}
        if answering:
            edges = window_edges(dataset.n_steps, dataset.spikes.step_ms, self.window_ms)
            program = tallied(dataset, samples, edges[lengths], n_features)
            program |= {kind: np.asarray(times, np.float64) for kind, times in answering.items()}
        return Answers(
            label=label,
            time_ms=ends_ms[lengths - 1],
            n_weights=self.n_weights(fitted.arrays, n_features),
            macs=macs,
            additions=input_spikes.sum(axis=0) / max(1, len(input_spikes)) + more,
            input_spikes=input_spikes,
            program=program,
            stored_bits=self.stored_bits(fitted.arrays) if program else None,
        )

    def _ends_ms(self, dataset: Dataset) -> Array:
        """Return when each window ends, (window,)."""
        if dataset.spikes.t_us is not None:
            return self._edges_us(dataset)[1:] / 1000
        edges = window_edges(dataset.n_steps, dataset.spikes.step_ms, self.window_ms)
        return edges[1:] * dataset.spikes.step_ms

    def _edges_us(self, dataset: Dataset) -> Array:
        return event_edges_us(dataset.n_steps * round(1000 * dataset.spikes.step_ms), self.window_ms)

    def counted(self, dataset: Dataset, samples: Array, channels: Channels | Ints) -> Array:
        """Return the spikes of each window by channel or group of channels (`window_counts`)."""
        spikes, start = dataset.spikes, dataset.start[samples]
        if spikes.t_us is not None:
            return event_counts(spikes, samples, start, self._edges_us(dataset), channels)
        edges = window_edges(dataset.n_steps, spikes.step_ms, self.window_ms)
        return window_counts(spikes, samples, start, edges, channels)


@dataclass(frozen=True)
class RateClassifier(Windowed):
    """A classifier of counts in windows.

    Rules of cost: W_t and multiply-accumulates are the family's; every input spike is one addition, to the
    count of its window.
    """

    window_ms: float = param(100.0, low=0, low_open=True, unit="ms", doc="counting window (Delta T)")
    channels: Channels = param(  # noqa: RUF009
        "sum", doc="sum: spikes of all channels are counted together, as published; each: per channel"
    )
    read_outs: int = fixed(
        50, low=1, high=50, doc="largest number of input lengths with a prediction, evenly spaced"
    )

    def counts(self, dataset: Dataset, samples: Array, wiring: Mapping[str, Array]) -> Array:
        """Return the counts of each window, (n, window, channel); one channel for 'sum'."""
        return self.counted(dataset, samples, self.channels)

    def most(self, dataset: Dataset) -> int:
        """Return the steps of the longest window, in each of which a channel spikes at most once."""
        edges = window_edges(dataset.n_steps, dataset.spikes.step_ms, self.window_ms)
        return most_spikes(edges.tolist(), dataset.spikes.n_channels if self.channels == "sum" else 1)
