"""Event file formats: how the bytes of one file become events.

A component of section `recordings.formats` is a frozen dataclass with the methods of `Format` below; to add
a format, register such a class in one file here. `checked` checks the events of all formats, so a reader
checks its own bytes alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, ClassVar, Protocol

import numpy as np

from dse.base.records import Array, Block, Bools, Ints
from dse.base.registry import known
from dse.data.recordings import RecordingError

BLOCK_EVENTS = 1 << 16
"""Events per block at most, roughly: what bounds the memory of a reader."""

_HEAD_BYTES = 4096


@dataclass(frozen=True)
class Repairs:
    """The faults of one file, which its reader calls: an error at the first, or with repair a note per kind.

    file: the name that the sentences begin with.
    repair: whether to repair a fault and continue.
    """

    file: str
    repair: bool
    _repaired: dict[str, tuple[str, int]] = field(default_factory=dict, init=False)

    def __call__(self, fault: str, repair: str, n: int = 1) -> None:
        """Report a fault of n things (events, words, bytes); this returns only if the user asked for repair.

        fault: what is wrong and where, as the beginning of a sentence: 'event 3 lies outside the frame'.
        repair: what repair does about every fault of this kind: 'drops events outside the frame'.

        Raises:
            RecordingError: the user did not ask for repair.
        """
        if not n:
            return
        if not self.repair:
            raise RecordingError(f"{self.file}: {fault}; --repair {repair}")
        first, before = self._repaired.get(repair, (fault, 0))
        self._repaired[repair] = (first, before + n)

    def where(self, bad: Bools, fault: str, repair: str, *values: Array) -> None:
        """Report those of many things that are bad; `fault` is formatted with the values of the first."""
        if bad.any():
            self(fault.format(*(x[int(bad.argmax())] for x in values)), repair, int(bad.sum()))

    @property
    def notes(self) -> list[str]:
        """What was repaired, one sentence per kind: its first fault, and how many there were."""
        return [
            f"{self.file}: {first}; --repair {repair}{f' ({n} in all)' if n > 1 else ''}"
            for repair, (first, n) in self._repaired.items()
        ]


class Format(Protocol):
    """What every event file format offers, and inherits.

    suffixes: of the names of its files, in small letters. marks: how the bytes of its files may begin.
    """

    suffixes: ClassVar[tuple[str, ...]]
    marks: ClassVar[tuple[bytes, ...]] = ()

    def matches(self, path: Path, head: bytes) -> bool:
        """Return whether the first 4 KiB (and the name, where the bytes carry no mark) are of this format."""
        return head.startswith(self.marks)

    def frame(self, path: Path) -> tuple[int, int] | None:
        """Return the width and height that the file or the format states, if it does.

        Raises:
            RecordingError: the file cannot be opened, or its header is wrong.
        """

    def blocks(self, path: Path, broken: Repairs) -> Iterator[Block]:
        """Yield the events in the file's order, about BLOCK_EVENTS at a time at most, and no empty block.

        Raises:
            RecordingError: the file cannot be opened, its header is wrong, or `broken` raised it.
        """


def block_of(t_us: Array, x: Array, y: Array, polarity: Array, chosen: Any = ...) -> Iterator[Block]:
    """Yield the chosen events as one block, in the types of a block; nothing where there are none."""
    block = Block(
        np.asarray(t_us[chosen], np.int64),
        np.asarray(x[chosen], np.int32),
        np.asarray(y[chosen], np.int32),
        np.asarray(polarity[chosen], np.uint8),
    )
    if len(block.t_us):
        yield block


def open_file(path: Path) -> BinaryIO:
    """Return the file, open for reading."""
    try:
        return path.open("rb")
    except OSError as problem:
        raise RecordingError(f"{path.name}: cannot be read: {problem.strerror or problem}") from problem


def read_words(
    path: Path, start: int, size: int, broken: Repairs, n: int | None = None
) -> Iterator[tuple[int, bytes]]:
    """Yield where words of `size` bytes begin, and n whole ones (BLOCK_EVENTS), from byte `start` on."""
    with open_file(path) as file:
        file.seek(start)
        while read := file.read((n or BLOCK_EVENTS) * size):
            if cut := len(read) % size:
                broken(
                    f"the last word must have {size} bytes, got {cut} at byte {start + len(read) - cut}",
                    "drops a truncated last word",
                )
            if len(read) >= size:
                yield start, read[: len(read) - cut]
            start += len(read)


class Clock:
    """A counter of times that wraps; called with the next ones, it returns them as if it never did.

    A fall by more than 7/8 of the period is a wrap; a smaller one is a time that runs backwards, and stays.
    """

    def __init__(self, period: int) -> None:
        self._period, self._before = period, 0

    def __call__(self, t: Array) -> Ints:
        """Return times of the file, (n,) int64 in [0, period), after those of earlier calls."""
        wraps = np.cumsum(np.diff(t, prepend=self._before % self._period) < -(self._period // 8 * 7))
        counted: Array = t + (wraps + self._before // self._period) * self._period
        self._before = int(counted[-1]) if len(counted) else self._before
        return counted


def named(name: str) -> Format:
    """Return the format of a name.

    Raises:
        RecordingError: there is no such format.
    """
    formats = known("recordings.formats")
    if name not in formats:
        raise RecordingError(f"format must be one of {', '.join(formats)}, got '{name}'")
    form: Format = formats[name]()
    return form


def detect(path: Path) -> Format:
    """Return the format of a file: by its content, or by its suffix where the content does not decide."""
    with open_file(path) as file:
        head = file.read(_HEAD_BYTES)
    formats: dict[str, Format] = {name: kind() for name, kind in known("recordings.formats").items()}
    fitting = {name: x for name, x in formats.items() if x.matches(path, head)}
    if len(fitting) != 1:
        pool = fitting or formats
        fitting = {name: x for name, x in pool.items() if path.suffix.lower() in x.suffixes} or fitting
    if len(fitting) == 1:
        return next(iter(fitting.values()))
    may = f"could be any of {', '.join(fitting)}" if fitting else "has no known format"
    raise RecordingError(f"{path.name}: {may}; set the key 'format' to one of {', '.join(formats)}")


def checked(blocks: Iterator[Block], width: int, height: int, broken: Repairs) -> Iterator[Block]:
    """Yield the blocks of one recording after checks: times never fall, addresses lie in the frame.

    With repair, in this order: events outside the frame or before 0 us are dropped; a polarity above 1 is ON;
    an event earlier than one before it takes the latest time so far. That loses none and brings none forward,
    but one wrong stamp far ahead holds up all that follow it: the note counts them.
    """
    n_read, n_kept, latest = 0, 0, 0
    for block in blocks:
        t_us, x, y, polarity = block.t_us, block.x, block.y, block.polarity
        number: Ints = np.arange(n_read, n_read + len(t_us))
        n_read += len(t_us)

        outside, early = (x < 0) | (x >= width) | (y < 0) | (y >= height), t_us < 0
        rule = (
            f"event {{}} must have its (x, y) within the frame of {width} x {height} pixels, got {{}}, {{}}"
        )
        broken.where(outside, rule, "drops events outside the frame", number, x, y)
        rule = "event {} must have a time of at least 0 us, got {}"
        broken.where(early, rule, "drops events before 0 us", number, t_us)
        rule = "event {} must have polarity 0 or 1, got {}"
        broken.where(polarity > 1, rule, "treats other polarities as ON", number, polarity)
        valid = ~(outside | early)
        if not valid.all():
            number, t_us, x, y, polarity = (part[valid] for part in (number, t_us, x, y, polarity))
        if not len(t_us):
            continue
        in_order = np.maximum.accumulate(np.maximum(t_us, latest))
        rule = "event {} must not be earlier than a previous event: time in us and latest time before, got "
        repair = "sets the time of an event out of order to the latest time before"
        broken.where(t_us < in_order, rule + "{}, {}", repair, number, t_us, in_order)
        latest = int(in_order[-1])
        n_kept += len(t_us)
        yield Block(in_order, x, y, np.minimum(polarity, 1))
    if not n_kept:
        broken("must have events, got none", "treats the file as a recording without events")
