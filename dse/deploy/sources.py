"""Where the items of a stream come from: lines of text, a serial port, recordings.

Lines have fields apart by commas, semicolons, blanks or tabs:

    samples   a number of every channel, a line per sample
    spikes    0 or 1 of every channel, a line per step
    events    t_us x y polarity (1 ON, 0 OFF), a line per event; t_us alone: no further event comes before it

A line of text before the first number is skipped; an empty line ends a recording.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np

from dse.deploy.bundle import Bundle
from dse.deploy.classifier import Input
from dse.deploy.reference import prepared
from dse.deploy.stream import Decision, Passed, Stream, Windows
from dse.native.extras import MissingExtra
from dse.recordings import RecordingError, Recordings, trials_of
from dse.records import Array, Block, Ints, Rasters, Signals

_CHUNK = 2**16
_LONGEST_LINE = 2**22


class End(NamedTuple):
    """The recording ends; what follows is another one.

    n_open: windows of it that have no answer.
    """

    n_open: int = 0


Item = Block | Array | Passed | End


def chunks_of_file(descriptor: int) -> Iterator[bytes]:
    """Yield what arrives at a file descriptor, as soon as it does, until it is closed."""
    while chunk := os.read(descriptor, _CHUNK):
        yield chunk


def chunks_of_serial(port: str, baud: int) -> Iterator[bytes]:
    """Open a serial port; yield what arrives at it, as soon as it does, until it is unplugged.

    Raises:
        MissingExtra: pyserial is not installed.
        RecordingError: the port cannot be opened.
    """
    if find_spec("serial") is None:
        raise MissingExtra("a serial port needs pyserial: pip install 'dse[serial]'")
    import serial

    try:
        connection = serial.Serial(port, baud)
    except (serial.SerialException, ValueError) as error:
        number = getattr(error, "errno", None)
        reason = os.strerror(number) if number else error
        raise RecordingError(f"{port}: the serial port cannot be opened: {reason}") from None
    return _read(connection)


def _read(connection: Any) -> Iterator[bytes]:
    from serial import SerialException

    with connection:
        while True:
            try:
                yield connection.read(max(1, connection.in_waiting))
            except (SerialException, OSError):
                return


def items_of_lines(chunks: Iterable[bytes], recordings: Input, name: str) -> Iterator[Item]:
    """Yield what lines of text say, as soon as they are complete; `End` between recordings.

    Args:
        chunks: of the text, which end anywhere.
        recordings: what the classifier takes.
        name: of the source, for messages.

    Raises:
        RecordingError: a line is malformed; the message names it.
    """
    parser, rest = _Lines(recordings, name), b""
    for chunk in chunks:
        *lines, rest = (rest + chunk).split(b"\n")
        yield from parser.items(lines)
        if len(rest) > _LONGEST_LINE:
            raise RecordingError(
                f"{name}: line {parser.number + 1} must be shorter than {_LONGEST_LINE} bytes"
            )
    if rest.strip():
        yield from parser.items([rest])


class _Lines:
    """Lines of a text, in the order of their numbers."""

    def __init__(self, recordings: Input, name: str) -> None:
        self.number = 0
        self._input, self._name = recordings, name
        self._has_begun = False
        self._last_us = 0

    def items(self, lines: Iterable[bytes]) -> Iterator[Item]:
        events: list[list[int]] = []
        for line in lines:
            self.number += 1
            fields = line.decode("ascii", "replace").replace(",", " ").replace(";", " ").split()
            if fields and not self._has_begun and not _is_number(fields[0]):
                continue  # the names of columns
            if self._input.kind == "events" and len(fields) > 1:
                events.append(self._event(fields))
                self._has_begun = True
                continue
            if events:
                yield _block(events)
                events = []
            if fields:
                self._has_begun = True
                yield self._time(fields) if self._input.kind == "events" else self._sample(fields)
            elif self._has_begun:
                self._has_begun, self._last_us = False, 0
                yield End()
        if events:
            yield _block(events)

    def _refusal(self, text: str) -> RecordingError:
        return RecordingError(f"{self._name}: line {self.number} {text}")

    def _sample(self, fields: list[str]) -> Array:
        n = self._input.n_channels
        if len(fields) != n:
            raise self._refusal(f"must have {n} numbers, got {len(fields)}")
        try:
            values = np.array([float(field) for field in fields])
        except ValueError:
            wrong = next(field for field in fields if not _is_number(field))
            raise self._refusal(f"must have numbers, got '{wrong}'") from None
        if not (np.abs(values) <= np.finfo(np.float32).max).all():
            raise self._refusal("must have finite numbers")
        if self._input.kind == "spikes" and not ((values == 0) | (values == 1)).all():
            raise self._refusal(f"must have 0 or 1 of every channel, got {values[values != 1].max():g}")
        return values

    def _whole(self, fields: list[str]) -> list[int]:
        try:
            return [int(field) for field in fields]
        except ValueError:
            raise self._refusal(f"must have whole numbers, got '{' '.join(fields)}'") from None

    def _time(self, fields: list[str]) -> Passed:
        [t_us] = self._whole(fields)
        self._check_time(t_us)
        return Passed(t_us)

    def _check_time(self, t_us: int) -> None:
        if not 0 <= t_us < 2**62:
            raise self._refusal(f"must have a time from 0 to 2^62 us, got {t_us}")
        if t_us < self._last_us:
            raise self._refusal(f"must not be earlier than the one before, at {self._last_us} us, got {t_us}")
        self._last_us = t_us

    def _event(self, fields: list[str]) -> list[int]:
        if len(fields) != 4:
            raise self._refusal(f"must have the 4 numbers t_us x y polarity, got {len(fields)}")
        t_us, x, y, polarity = event = self._whole(fields)
        self._check_time(t_us)
        width, height = self._input.width, self._input.height
        if not (0 <= x < width and 0 <= y < height):
            raise self._refusal(f"must have x below {width} and y below {height}, got {x} and {y}")
        if polarity not in (0, 1):
            raise self._refusal(f"must have the polarity 0 or 1, got {polarity}")
        return event


def _is_number(field: str) -> bool:
    try:
        float(field)
    except ValueError:
        return False
    return True


def _block(events: list[list[int]]) -> Block:
    t_us, x, y, polarity = np.array(events, np.int64).T
    return Block(
        np.ascontiguousarray(t_us), x.astype(np.int32), y.astype(np.int32), polarity.astype(np.uint8)
    )


def items_of_recording(recordings: Recordings, i: int) -> Iterator[Block | Array | Passed]:
    """Yield recording i as a stream takes it."""
    if isinstance(recordings, Signals):
        yield from recordings.values[recordings.offsets[i] : recordings.offsets[i + 1]]
    elif isinstance(recordings, Rasters):
        spikes, n = recordings.spikes, recordings.spikes.n_steps
        for row in range(i * n, (i + 1) * n):
            values = np.zeros(spikes.n_channels, np.uint8)
            values[spikes.channel[spikes.row_offsets[row] : spikes.row_offsets[row + 1]]] = 1
            yield values
    else:
        yield from recordings.blocks(i)
        if (trials := trials_of(recordings)) is not None:
            yield Passed(trials.duration_us)


def recordings_of(
    bundle: Bundle, recordings: Recordings, first_step: Ints, windows: Windows | None = None
) -> Iterator[tuple[Callable[[], Stream], Iterator[Block | Array | Passed]]]:
    """Yield what makes a stream of each recording, and what it takes.

    Args:
        bundle: as read.
        recordings: that it takes.
        first_step: (n,) where the window of each begins.
        windows: where they begin instead.
    """
    t0_us = None if isinstance(recordings, Signals | Rasters) or trials_of(recordings) is None else 0
    for i, first in enumerate(first_step.tolist()):
        once = windows or Windows("once", first=first)
        yield partial(Stream, bundle, once, t0_us), items_of_recording(recordings, i)


def paced(items: Iterable[Item], step_ms: float) -> Iterator[Item]:
    """Yield items when they are due by their own time, that of the first one being now."""
    began, n, first_us = time.monotonic(), 0, None
    for item in items:
        if isinstance(item, End):
            began, n, first_us = time.monotonic(), 0, None
            yield item
        elif isinstance(item, Block):
            if first_us is None and len(item.t_us):
                first_us = int(item.t_us[0])
            for part in by_step(item, step_ms):
                _wait(began + (int(part.t_us[-1]) - (first_us or 0)) / 1e6)
                yield part
        elif isinstance(item, Passed):
            _wait(began + (item.t_us - (first_us or 0)) / 1e6)
            yield item
        else:
            _wait(began + n * step_ms / 1e3)
            n += 1
            yield item


def by_step(block: Block, step_ms: float) -> Iterator[Block]:
    """Yield events in blocks of at most a step."""
    cuts = np.flatnonzero(np.diff(block.t_us // max(1, round(step_ms * 1000)))) + 1
    fields = (np.split(x, cuts) for x in (block.t_us, block.x, block.y, block.polarity))
    yield from (Block(*part) for part in zip(*fields, strict=True) if len(part[0]))


def _wait(until: float) -> None:
    if (left := until - time.monotonic()) > 0:
        time.sleep(left)


def played(bundle: Bundle, items: Iterable[Item], windows: Windows | None = None) -> Iterator[Decision | End]:
    """Yield the decisions on items as they fall, and `End` where a recording has ended.

    Raises:
        BundleError: the bundle cannot run on a stream.
        RecordingError: an item does not fit.
    """
    stream = Stream(bundle, windows)
    for item in items:
        if isinstance(item, End):
            yield from _ended(stream)
            stream = Stream(bundle, windows)
        else:
            yield from stream.push(item)
    yield from _ended(stream)


def _ended(stream: Stream) -> Iterator[Decision | End]:
    yield from stream.end()
    yield End(stream.n_open)


def replayed(
    bundle: Bundle, data_file: str, windows: Windows | None = None, realtime: bool = False
) -> Iterator[Decision | End]:
    """Yield the decisions on recordings, one after the other, as they fall, and `End` after each.

    Args:
        bundle: as read.
        data_file: recordings of the kind that the bundle was trained on.
        windows: where windows begin; None: one window of each, where `dse evaluate` has it.
        realtime: whether samples and events come at their own pace.

    Raises:
        BundleError: the bundle cannot run on a stream, or not on such recordings.
        RecordingError: the recordings do not fit.
    """
    new = prepared(bundle, data_file)
    first_step = new.first + new.dataset.start
    for make, items in recordings_of(bundle, new.recordings, first_step, windows):
        stream = make()
        for item in paced(items, stream.step_ms) if realtime else items:
            assert not isinstance(item, End)  # a recording has none inside
            yield from stream.push(item)
        yield from _ended(stream)
