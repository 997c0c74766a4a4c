"""A classifier on a stream: samples, spikes or events in, decisions out as soon as they fall.

Encoder, preprocessing and network run step by step, with the spikes and decisions that they have on the same
recording as a whole. A stream is one recording without end: the encoder runs from its first sample, and bins
are counted from its first event. Where windows begin is a rule (`Windows`); every window has a network of its
own, at rest at its first step. A classifier that is no single network answers once its window is complete.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np

from dse.base.native.compiled import compiled
from dse.base.records import Array, Block, Floats, Ints
from dse.data.preprocessing.bins import Bin, Bins
from dse.data.recordings import RecordingError
from dse.data.recordings.pooling import pooling
from dse.deploy.classifier import BundleError, Classifier, Input
from dse.deploy.window import Decision, Window, opener_of

Rule = Literal["once", "restart", "onset", "every"]
RULES: tuple[Rule, ...] = get_args(Rule)


@dataclass(frozen=True)
class Windows:
    """Where windows begin in a stream.

    rule: 'once': one window, from step `first` on; 'restart': the next one begins with the step after an
        answer; 'onset': a window begins at each onset of contact, as `window.onset_threshold` defines it,
        while none is open; 'every': one begins every `every` steps, and several are open at a time.
    first: step of the stream, from 0, before which none begins.
    """

    rule: Rule = "restart"
    every: int = 0
    first: int = 0

    def __post_init__(self) -> None:
        if self.rule not in RULES:
            raise ValueError(f"rule must be one of {', '.join(RULES)}, got '{self.rule}'")
        if (self.rule == "every") != (self.every > 0):
            raise ValueError(f"every must be > 0 for the rule 'every' and only there, got {self.every}")
        if self.first < 0:
            raise ValueError(f"first must be >= 0, got {self.first}")


class Passed(NamedTuple):
    """No further event comes before a time."""

    t_us: int


class Spiking(NamedTuple):
    """The channels that spike in an input step, past encoder and preprocessing: int32, rising, each once."""

    channels: Ints


Item = Block | Array | Passed | Spiking
"""What a stream takes: of signals, a number for each channel; of rasters, 0 or 1 for each channel; of events,
a block whose time never falls and goes on from the last one, or a time that has passed."""


class _Step(NamedTuple):
    """What happens in an input step of all recordings that a stream is cut into.

    values: what an encoder is fed; None: the channels spike as they are.
    t_us: times of these spikes, where they have any.
    moved: what contact is told by; None: how far the values are from the first ones.
    """

    values: Floats | None
    channels: Ints
    t_us: Ints | None
    moved: float | None


_NONE = np.zeros(0, np.int32)


class Stream:
    """A bundle on one stream.

    Args:
        bundle: as read.
        windows: where windows begin; None: as in training, that is at each onset of contact for
            `window.at: contact_onset`, else one after the other. With `window.cut_steps` the stream is cut
            into recordings, as recordings are in training, each with one window.
        t0_us: time that bins of events are counted from; None: the first event.

    `input` says what it takes.

    Raises:
        BundleError: the bundle cannot run on a stream; one sentence says why.
    """

    def __init__(self, bundle: Classifier, windows: Windows | None = None, t0_us: int | None = None) -> None:
        if bundle.input is None:
            raise BundleError(
                "bundle.json must say what recordings the bundle takes (key input): export it again"
            )
        window = bundle.sections.window
        if window.remove_mean:
            raise BundleError("window.remove_mean must be false on a stream: a mean is known at the end")
        self._bundle, self.input = bundle, bundle.input
        self._cut = window.cut_steps if windows is None else None
        self._every = window.every_steps or self._cut or 0
        self._windows = _usual(bundle, self.input) if windows is None else windows
        self._numbers = itertools.count()
        self._step = 0
        self._last_us = 0
        self._bins: Bins | None = None
        self._n_in = self.input.n_channels
        try:
            if (settings := bundle.sections.preprocessing) is not None:
                pools = pooling(settings, self.input.width, self.input.height)
                self._bins = Bins(pools, settings.every_event, t0_us)
                self._n_in = pools.n_channels
            self._open = opener_of(bundle, self.input)
            first = _Track(self)
        except ValueError as error:
            raise BundleError(str(error)) from None
        self._tracks = [] if self._cut else [first]

    @property
    def n_open(self) -> int:
        """Windows that have no answer yet."""
        return sum(len(track.windows) for track in self._tracks)

    def decisions(self, items: Iterable[Item]) -> Iterator[Decision]:
        """Yield the decisions on items, to their end, as they fall (`push`)."""
        for item in items:
            yield from self.push(item)
        yield from self.end()

    def push(self, item: Item) -> list[Decision]:
        """Return the decisions that fall with the next sample or step, or with some events.

        Raises:
            RecordingError: it does not fit.
        """
        if isinstance(item, Spiking):
            return self._advance(_Step(None, item.channels, None, len(item.channels)))
        if isinstance(item, Block | Passed) != (self._bins is not None):
            got = (
                "events" if isinstance(item, Block) else "a time" if isinstance(item, Passed) else "a sample"
            )
            raise RecordingError(f"the bundle takes {self.input.kind}, got {got}")
        if isinstance(item, Passed):
            if fault := self.input.fault_of_time(item.t_us, self._last_us):
                raise RecordingError(f"a time {fault}")
            self._last_us = item.t_us
            return self._binned(self._bins.advance(item.t_us))  # type: ignore[union-attr]
        if isinstance(item, Block):
            self._check_events(item)
            return self._binned(self._bins.push(item))  # type: ignore[union-attr]
        sample = np.asarray(item)
        if fault := self.input.fault_of_sample(sample):
            raise RecordingError(f"a sample {fault}")
        row = sample.astype(np.float32)
        if self.input.kind == "spikes":
            return self.push(Spiking(np.flatnonzero(row).astype(np.int32)))
        return self._advance(_Step(row, _NONE, None, None))

    def end(self) -> list[Decision]:
        """Return the decisions that fall with the last bin of events, which may be partly empty."""
        return [] if self._bins is None else self._binned(self._bins.end())

    def _binned(self, bins: Iterator[Bin]) -> list[Decision]:
        decisions: list[Decision] = []
        for channels, t_us, n_events in bins:
            values = None
            if self._bundle.sections.encoder is not None:
                values = np.bincount(channels, minlength=self._n_in).astype(np.float32)
            decisions += self._advance(_Step(values, channels, t_us, n_events))
        return decisions

    def _advance(self, step: _Step) -> list[Decision]:
        """Take a step; begin and end the recordings that a stream is cut into."""
        if self._cut and self._step % self._every == 0:
            self._tracks.append(_Track(self))
        decisions = [decision for track in self._tracks for decision in track.take(step)]
        self._step += 1
        if self._tracks and self._step - self._tracks[0].begin == self._cut:
            del self._tracks[0]
        return decisions

    def _check_events(self, block: Block) -> None:
        if not len(block.t_us):
            return
        width, height, last_us = self.input.width, self.input.height, self._last_us
        at = _first_fault(block.t_us, block.x, block.y, block.polarity, last_us, width, height)
        if at >= 0:
            last_us = int(block.t_us[at - 1]) if at else last_us
            t_us, x, y, polarity = (
                int(column[at]) for column in (block.t_us, block.x, block.y, block.polarity)
            )
            fault = self.input.fault_of_event(t_us, x, y, polarity, last_us)
            raise RecordingError(f"event {at} {fault}")
        self._last_us = int(block.t_us[-1])


def _usual(bundle: Classifier, recordings: Input) -> Windows:
    """Return where windows begin as in training: of a stream, or of each recording that it is cut into."""
    window = bundle.sections.window
    if window.at == "contact_onset":
        return Windows("onset")
    if window.cut_steps is None:
        return Windows("restart")
    return Windows("once", first=(window.cut_steps - recordings.n_steps) // 2 if window.at == "middle" else 0)


class _Track:
    """One recording within a stream, from its present step on: its encoder, and its windows."""

    def __init__(self, stream: Stream) -> None:
        self.begin = stream._step
        self.windows: list[Window] = []
        self._stream, self._rule, self._step, self._touched = stream, stream._windows, 0, False
        self._left = 1 if stream._cut or self._rule.rule == "once" else math.inf
        sections = stream._bundle.sections
        self._encoder, self._encodes_from = None, 0
        if sections.encoder is not None:
            self._encoder = sections.encoder.running(stream._n_in, stream.input.step_ms)
            if stream._bins is not None:
                # Spikes of recordings are stored, and encoded, from where training windows may begin.
                self._encodes_from = max(self._rule.first - sections.window.jitter_steps, 0)
        self._onset_threshold = sections.window.onset_threshold
        self._first_values: Floats | None = None

    def take(self, step: _Step) -> list[Decision]:
        """Return the decisions that fall in the next step."""
        values, channels, t_us, moved = step
        if values is not None:
            assert self._encoder is not None
            if self._step < self._encodes_from:
                channels, t_us = _NONE, None
            else:
                channels, t_us = self._encoder.step(values), None
            if moved is None:
                self._first_values = values if self._first_values is None else self._first_values
                moved = np.abs(values - self._first_values).max() if self._rule.rule == "onset" else 0.0
        touches = bool(moved is not None and moved >= self._onset_threshold)
        if self._left and self._begins(touches):
            begin_ms = (self.begin + self._step) * self._stream.input.step_ms
            self.windows.append(self._stream._open(next(self._stream._numbers), begin_ms))
            self._left -= 1
        self._touched = touches
        self._step += 1
        taken = [(window, window(channels, t_us)) for window in self.windows]
        self.windows = [window for window, decision in taken if decision is None]
        return [decision for _, decision in taken if decision is not None]

    def _begins(self, touches: bool) -> bool:
        """Return whether a window begins with the present step."""
        since = self._step - self._rule.first
        if since < 0:
            return False
        if self._rule.rule == "every":
            return since % self._rule.every == 0
        if self._rule.rule == "onset":
            return touches and not self._touched and not self.windows
        return not self.windows


@compiled()
def _first_fault(t_us, x, y, polarity, last_us, width, height):  # type: ignore[no-untyped-def]
    """Return the first event whose time falls, or whose address or polarity is none; -1: there is none."""
    for e in range(len(t_us)):
        if not (
            last_us <= t_us[e] < 2**62 and 0 <= x[e] < width and 0 <= y[e] < height and 0 <= polarity[e] <= 1
        ):
            return e
        last_us = t_us[e]
    return -1
