"""A classifier on a stream: samples, spikes or events in, decisions out as soon as they fall.

Encoder, preprocessing and network run step by step, with the spikes and decisions that they have on the same
recording as a whole. A stream is one recording without end: the encoder runs from its first sample, and bins
are counted from its first event. Where windows begin is a rule (`Windows`); every window has a network of its
own, at rest at its first step. A classifier that is no single network answers once its window is complete.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np

from dse.deploy.classifier import BundleError, Classifier, Input
from dse.deploy.window import Window, opener_of
from dse.native.compiled import compiled
from dse.preprocessing.bins import Bin, Bins
from dse.recordings import RecordingError
from dse.recordings.events import event_faults
from dse.recordings.pooling import pooling
from dse.records import Array, Block, Floats, Ints

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


class Decision(NamedTuple):
    """The answer to one window.

    window: its number, from 0. begin_ms: its first step, by the time of the stream.
    answer: the class; None: a combination of the heads' answers that no training recording had.
    time_ms: from the beginning of the window to the answer.
    confidence: share of the output spikes that are of the class; 0 without spikes, None of a classifier
        without output spikes. margin: the same, minus the share of the class that is second.
        Of a joint net that answers with all heads together: the lowest over its heads.
    decided: whether theta was reached; true where the answer comes at a fixed time.
    """

    window: int
    begin_ms: float
    answer: str | None
    time_ms: float
    confidence: float | None
    margin: float | None
    decided: bool


class Passed(NamedTuple):
    """No further event comes before a time."""

    t_us: int


class Stream:
    """A bundle on one stream.

    Args:
        bundle: as read.
        windows: where windows begin; None: as in training, that is at each onset of contact for
            `window.at: contact_onset`, else one after the other. With `window.cut_steps` the stream is cut
            into recordings, as recordings are in training, each with one window.
        t0_us: time that bins of events are counted from; None: the first event.

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
        self._bundle, self._input = bundle, bundle.input
        self._cut = window.cut_steps if windows is None else None
        self._every = window.every_steps or self._cut or 0
        self._windows = _usual(bundle, self._input) if windows is None else windows
        self._numbers = itertools.count()
        self._step = 0
        self._last_us = 0
        self._bins: Bins | None = None
        self._n_in = self._input.n_channels
        try:
            if (settings := bundle.sections.preprocessing) is not None:
                pools = pooling(settings, self._input.width, self._input.height)
                self._bins = Bins(pools, settings.every_event, t0_us)
                self._n_in = pools.n_channels
            self._open = opener_of(bundle, self._input)
            first = _Track(self)
        except ValueError as error:
            raise BundleError(str(error)) from None
        self._tracks = [] if self._cut else [first]

    @property
    def input(self) -> Input:
        """What it takes."""
        return self._input

    @property
    def step_ms(self) -> float:
        """Duration of an input step."""
        return self._input.step_ms

    @property
    def n_steps(self) -> int:
        """Input steps so far."""
        return self._step

    @property
    def n_open(self) -> int:
        """Windows that have no answer yet."""
        return sum(len(track.windows) for track in self._tracks)

    def push(self, item: Block | Array | Passed) -> list[Decision]:
        """Return the decisions that fall with the next sample, or with some events.

        Args:
            item: of signals, a number for each channel; of rasters, 0 or 1 for each channel; of events, a
                block whose time never falls and goes on from the last one, or a time that has passed.

        Raises:
            RecordingError: it does not fit.
        """
        if isinstance(item, Passed):
            return self.time(item.t_us)
        if isinstance(item, Block) != (self._bins is not None):
            got = "events" if isinstance(item, Block) else "a sample"
            raise RecordingError(f"the bundle takes {self._input.kind}, got {got}")
        if isinstance(item, Block):
            self._check_events(item)
            assert self._bins is not None
            return self._binned(self._bins.push(item))
        row = self._checked(item)
        if self._input.kind == "spikes":
            return self.spikes(np.flatnonzero(row).astype(np.int32))
        return self._advance(lambda track: track.sample(row))

    def spikes(self, channels: Ints) -> list[Decision]:
        """Return the decisions that fall in the next input step, past encoder and preprocessing.

        Args:
            channels: int32 channels that spike, rising, each once.
        """
        return self._advance(lambda track: track.step(channels, None, len(channels)))

    def time(self, t_us: int) -> list[Decision]:
        """Return the decisions that fall because no further event comes before a time.

        Raises:
            RecordingError: the bundle takes no events, or the time falls.
        """
        if self._bins is None:
            raise RecordingError(f"the bundle takes {self._input.kind}, got a time")
        if t_us < self._last_us:
            raise RecordingError(f"times must not decrease, got {t_us} after {self._last_us}")
        self._last_us = t_us
        return self._binned(self._bins.advance(t_us))

    def end(self) -> list[Decision]:
        """Return the decisions that fall with the last bin of events, which may be partly empty."""
        return [] if self._bins is None else self._binned(self._bins.end())

    def _binned(self, bins: Iterator[Bin]) -> list[Decision]:
        decisions: list[Decision] = []
        for each in bins:
            decisions += self._advance(lambda track, each=each: track.bin(each))  # type: ignore[misc]
        return decisions

    def _advance(self, step: Callable[[_Track], list[Decision]]) -> list[Decision]:
        """Take a step; begin and end the recordings that a stream is cut into."""
        if self._cut and self._step % self._every == 0:
            self._tracks.append(_Track(self))
        decisions = [decision for track in self._tracks for decision in step(track)]
        self._step += 1
        if self._tracks and self._step - self._tracks[0].begin == self._cut:
            del self._tracks[0]
        return decisions

    def _checked(self, item: Array) -> Floats:
        """Return a sample as float32.

        Raises:
            RecordingError: it has another number of channels, or what is no number of a sensor.
        """
        n = self._input.n_channels
        values = np.asarray(item)
        if values.shape != (n,) or values.dtype.kind not in "biuf":
            raise RecordingError(f"a sample must be {n} numbers, got {values.dtype} of shape {values.shape}")
        with np.errstate(over="ignore"):  # what is too large for float32 is reported as infinite
            row = values.astype(np.float32)
        if not np.isfinite(row).all():
            raise RecordingError(f"a sample must be finite, got {row[~np.isfinite(row)][0]}")
        if self._input.kind == "spikes" and not ((row == 0) | (row == 1)).all():
            raise RecordingError(f"spikes must be 0 or 1, got {row[(row != 0) & (row != 1)][0]:g}")
        return row

    def _check_events(self, block: Block) -> None:
        if not len(block.t_us):
            return
        width, height, last_us = self._input.width, self._input.height, self._last_us
        if not _sound(block.t_us, block.x, block.y, block.polarity, last_us, width, height):
            if 0 <= block.t_us[0] < last_us:
                raise RecordingError(f"times must not decrease, got {block.t_us[0]} after {last_us}")
            t_us, x, y, polarity = (
                field.astype(np.int64) for field in (block.t_us, block.x, block.y, block.polarity)
            )
            borders = np.array([0, len(t_us)])
            raise RecordingError(event_faults(t_us, x, y, polarity, borders, width, height)[0])
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
        self.windows: list[tuple[int, float, Window]] = []
        self._stream, self._rule, self._step, self._touched = stream, stream._windows, 0, False
        self._left = 1 if stream._cut or self._rule.rule == "once" else math.inf
        sections, n_in = stream._bundle.sections, stream._n_in
        self._encoder, self._encodes_from = None, 0
        if sections.encoder is not None:
            self._encoder = sections.encoder.running(n_in, stream.step_ms)
        if sections.encoder is not None and stream._bins is not None:
            # Spikes of recordings are stored, and encoded, from where training windows may begin.
            self._encodes_from = max(self._rule.first - sections.window.jitter_steps, 0)
        self._onset_threshold = sections.window.onset_threshold
        self._counts = np.zeros(n_in, np.float32)
        self._first_sample: Floats | None = None

    def sample(self, row: Floats) -> list[Decision]:
        """Take a sample, (channel,) float32."""
        assert self._encoder is not None  # samples have one
        moved = 0.0
        if self._rule.rule == "onset":
            self._first_sample = row if self._first_sample is None else self._first_sample
            moved = np.abs(row - self._first_sample).max()
        return self.step(self._encoder.step(row), None, moved)

    def bin(self, bin: Bin) -> list[Decision]:
        """Take the events of a step."""
        channels, t_us = bin.channels, bin.t_us
        if self._encoder is not None:
            self._counts[:] = 0
            np.add.at(self._counts, channels, 1)
            late = self._step >= self._encodes_from
            channels, t_us = self._encoder.step(self._counts) if late else channels[:0], None
        return self.step(channels, t_us, bin.n_events)

    def step(self, channels: Ints, t_us: Ints | None, moved: float) -> list[Decision]:
        """Take the spikes of a step, and what contact is told by: it touches from the onset threshold on."""
        touches, stream = bool(moved >= self._onset_threshold), self._stream
        if self._left and self._begins(touches):
            begin_ms = (self.begin + self._step) * stream.step_ms
            self.windows.append((next(stream._numbers), begin_ms, stream._open()))
            self._left -= 1
        self._touched = touches
        self._step += 1
        decisions, still = [], []
        for number, begin_ms, window in self.windows:
            verdict = window.step(channels, t_us)
            if verdict is None:
                still.append((number, begin_ms, window))
                continue
            answer = stream._bundle.answers[verdict.label] if verdict.label >= 0 else None
            time_ms, confidence, margin = verdict.time_ms, verdict.confidence, verdict.margin
            decisions.append(Decision(number, begin_ms, answer, time_ms, confidence, margin, verdict.decided))
        self.windows = still
        return decisions

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
def _sound(t_us, x, y, polarity, last_us, width, height):  # type: ignore[no-untyped-def]
    """Return whether times never fall, and every address and polarity is one."""
    for e in range(len(t_us)):
        if t_us[e] < last_us or not (0 <= x[e] < width and 0 <= y[e] < height) or polarity[e] > 1:
            return False
        last_us = t_us[e]
    return True
