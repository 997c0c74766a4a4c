"""Where the items of a stream come from: lines of text, recordings.

Lines have fields apart by commas, semicolons, blanks or tabs:

    samples   a number of every channel, a line per sample
    spikes    0 or 1 of every channel, a line per step
    events    t_us x y polarity (1 ON, 0 OFF), a line per event; t_us alone: no further event comes before it

A line of text before the first number is skipped; an empty line ends a recording.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from dse.base.records import Block, Ints, Rasters, Signals
from dse.data.recordings import RecordingError, Recordings, trials_of
from dse.deploy.bundle import Bundle
from dse.deploy.classifier import Input
from dse.deploy.reference import prepared
from dse.deploy.stream import Item, Passed, Stream, Windows
from dse.deploy.window import Decision

_CHUNK = 2**16
_LONGEST_LINE = 2**22


class Recording(NamedTuple):
    """A recording as a stream takes it.

    items: each as soon as it is there.
    windows, t0_us: of its stream (`dse.deploy.stream.Stream`).
    """

    items: Iterable[Item]
    windows: Windows | None = None
    t0_us: int | None = None


class End(NamedTuple):
    """A recording has ended.

    n_open: windows of it that have no answer.
    """

    n_open: int = 0


def played(bundle: Bundle, recordings: Iterable[Recording]) -> Iterator[Decision | End]:
    """Yield the decisions on recordings, one after the other, as they fall, and `End` after each.

    Raises:
        BundleError: the bundle cannot run on a stream.
        RecordingError: an item does not fit.
    """
    for items, windows, t0_us in recordings:
        stream = Stream(bundle, windows, t0_us)
        yield from stream.decisions(items)
        yield End(stream.n_open)


def recordings_of_file(bundle: Bundle, data_file: str, windows: Windows | None = None) -> Iterator[Recording]:
    """Return recordings of the kind that a bundle was trained on.

    Args:
        bundle: as read.
        data_file: where they are.
        windows: where windows begin; None: one window of each, where `dse evaluate` has it.

    Raises:
        BundleError: the bundle cannot run on such recordings.
        RecordingError: the recordings do not fit.
    """
    new = prepared(bundle, data_file)
    return recordings_of(new.recordings, new.first + new.dataset.start, windows)


def recordings_of(
    recordings: Recordings, first_step: Ints, windows: Windows | None = None
) -> Iterator[Recording]:
    """Yield recordings as a stream takes them: windows begin at their (n,) first steps, or by a rule."""
    is_sampled = isinstance(recordings, Signals | Rasters)
    t0_us = None if is_sampled or trials_of(recordings) is None else 0  # type: ignore[arg-type]
    for i, first in enumerate(first_step.tolist()):
        yield Recording(_items(recordings, i), windows or Windows("once", first=first), t0_us)


def _items(recordings: Recordings, i: int) -> Iterator[Item]:
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


def recordings_of_lines(
    chunks: Iterable[bytes], taken: Input, name: str, windows: Windows | None = None
) -> Iterator[Recording]:
    """Yield recordings whose items are what lines of text say, as soon as these are complete.

    Args:
        chunks: of the text, which end anywhere.
        taken: what the classifier takes.
        name: of the source, for messages.
        windows: where windows begin.
    """
    items, is_over = _items_of_lines(_lines(chunks, name), taken, name), False

    def recording() -> Iterator[Item]:
        nonlocal is_over
        for item in items:
            if item is None:
                return
            yield item
        is_over = True

    while not is_over:
        yield Recording(recording(), windows)


def _lines(chunks: Iterable[bytes], name: str) -> Iterator[list[bytes]]:
    """Yield the lines of a text, those together that have arrived together."""
    rest, number = b"", 1
    for chunk in chunks:
        *lines, rest = (rest + chunk).split(b"\n")
        number += len(lines)
        yield lines
        if len(rest) > _LONGEST_LINE:
            raise RecordingError(f"{name}: line {number} must be shorter than {_LONGEST_LINE} bytes")
    if rest.strip():
        yield [rest]


def _items_of_lines(arriving: Iterable[list[bytes]], taken: Input, name: str) -> Iterator[Item | None]:
    """Yield what lines say, events that have arrived together as a block; None: a recording has ended."""
    number, has_begun, last_us = 0, False, 0
    events: list[list[int]] = []

    def check(fault: str) -> None:
        if fault:
            raise RecordingError(f"{name}: line {number} {fault}")

    def whole(fields: list[str]) -> list[int]:
        try:
            return [int(field) for field in fields]
        except ValueError:
            text = f"must have whole numbers, got '{' '.join(fields)}'"
            raise RecordingError(f"{name}: line {number} {text}") from None

    for lines in arriving:
        for line in lines:
            number += 1
            fields = line.decode("ascii", "replace").replace(",", " ").replace(";", " ").split()
            if not has_begun and not (fields and _is_number(fields[0])):
                continue  # the names of columns
            has_begun = True
            if events and len(fields) < 2:
                yield _block(events)
                events = []
            if not fields:
                has_begun, last_us = False, 0
                yield None
            elif taken.kind != "events":
                wrong = next((field for field in fields if not _is_number(field)), None)
                check("" if wrong is None else f"must have numbers, got '{wrong}'")
                values = np.array([float(field) for field in fields])
                check(taken.fault_of_sample(values))
                yield values
            elif len(fields) == 1:
                [t_us] = whole(fields)
                check(taken.fault_of_time(t_us, last_us))
                last_us = t_us
                yield Passed(t_us)
            else:
                if len(fields) != 4:
                    check(f"must have the 4 numbers t_us x y polarity, got {len(fields)}")
                t_us, x, y, polarity = event = whole(fields)
                check(taken.fault_of_event(t_us, x, y, polarity, last_us))
                last_us = t_us
                events.append(event)
        if events:
            yield _block(events)
            events = []


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


def chunks_of_file(descriptor: int) -> Iterator[bytes]:
    """Yield what arrives at a file descriptor, as soon as it does, until it is closed."""
    while chunk := os.read(descriptor, _CHUNK):
        yield chunk


def by_step(items: Iterable[Item], step_ms: float) -> Iterator[Item]:
    """Yield items, events in blocks of at most a step."""
    for item in items:
        if not isinstance(item, Block):
            yield item
            continue
        cuts = np.flatnonzero(np.diff(item.t_us // max(1, round(step_ms * 1000)))) + 1
        fields = (np.split(x, cuts) for x in (item.t_us, item.x, item.y, item.polarity))
        yield from (Block(*part) for part in zip(*fields, strict=True) if len(part[0]))
