"""Files of Prophesee cameras: text lines, each with a '%' in front, then words of DAT, EVT 2.0 or EVT 3.0."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from dse.base.records import Block, Bools, Ints
from dse.base.registry import register
from dse.data.recordings import RecordingError
from dse.data.recordings.formats import BLOCK_EVENTS, Clock, Format, Repairs, block_of, open_file, read_words

_MOST_BYTES = 1 << 16
_LONGEST_LINE = 1 << 10
# Printable, so that words that happen to begin with '%' are not taken for a line; nothing is tried twice.
_LINE = re.compile(rb"%(?: *+([^\x00-\x20\x7f]++)[ \t]*+([^\x00-\x08\x0a-\x1f\x7f]*+)|[ \t]*+)\r?\n")
_GEOMETRY = re.compile(r"(\d{1,5})x(\d{1,5})")
_DAT_VERSION, _DAT_TYPES, _DAT_BYTES = "2", (0x00, 0x0C), 8  # events as written by old and by new cameras
_DAT_PERIOD_US = 1 << 32  # 1.2 hours
_MOST_PER_WORD = 12  # events in a word of EVT 3.0
_NO_BASE = -(1 << 40)


@dataclass(frozen=True)
class Header:
    """The text lines before the words.

    fields: first word of a line in small letters -> the rest of it; so are the parts of a '% format' line.
    end: bytes of the header.
    """

    fields: Mapping[str, str]
    end: int

    @property
    def evt(self) -> str | None:
        """The version of the EVT encoding, such as '2.0', where a line states it."""
        if "evt" in self.fields:
            return self.fields["evt"]
        named = re.fullmatch(r"EVT(\d)(\d?)", self.fields.get("format", ""))
        return f"{named[1]}.{named[2] or 0}" if named else None

    @property
    def frame(self) -> tuple[int, int] | None:
        """Width and height in pixels, where the lines state them."""
        geometry = _GEOMETRY.fullmatch(self.fields.get("geometry", ""))
        width, height = geometry.groups() if geometry else map(self.fields.get, ("width", "height"))
        if width and height and _GEOMETRY.fullmatch(f"{width}x{height}") and int(width) and int(height):
            return int(width), int(height)
        return None


def parse(head: bytes) -> Header:
    """Return the header that the first bytes of a file hold; without one it has no fields and ends at 0."""
    fields: dict[str, str] = {}
    end = 0
    while line := _LINE.match(head, end):
        end = line.end()
        key, value = ((x or b"").decode("latin-1").strip() for x in line.groups())
        if key.lower() == "format":
            value, *parts = value.split(";")
            fields |= {name.lower(): rest for name, _, rest in (part.partition("=") for part in parts)}
        fields[key.lower()] = value
        if key == "end":
            break
    return Header(fields, end)


def _read_header(path: Path) -> Header:
    with open_file(path) as file:
        header = parse(file.read(_MOST_BYTES))
    if header.end > _MOST_BYTES - _LONGEST_LINE:
        raise RecordingError(f"{path.name}: the header must end within {_MOST_BYTES - _LONGEST_LINE} bytes")
    return header


class _Prophesee(Format):
    """What the formats share: the frame is that of the header."""

    def frame(self, path: Path) -> tuple[int, int] | None:
        return _read_header(path).frame


@register("recordings.formats", "dat")
@dataclass(frozen=True)
class Dat(_Prophesee):
    """Prophesee DAT version 2 (.dat); its 32-bit time may wrap.

    8 bytes per event: time, then 14 bits of column, 14 of row, and the polarity.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".dat",)

    def matches(self, path: Path, head: bytes) -> bool:
        """Return whether a header and the type and size of CD events are there."""
        header = parse(head)
        mark = head[header.end : header.end + 2]
        typed = len(mark) == 2 and mark[0] in _DAT_TYPES and mark[1] == _DAT_BYTES
        return header.end > 0 and header.evt is None and (typed or "version" in header.fields)

    def blocks(self, path: Path, broken: Repairs) -> Iterator[Block]:
        """Yield the events; other events than CD events of version 2 are an error."""
        header = _read_header(path)
        version = header.fields.get("version")
        if version is None:
            broken(
                "the header must state the version in a line '% Version 2', which is missing",
                f"reads the data after {header.end} bytes of header as version 2",
            )
        elif version != _DAT_VERSION:
            raise RecordingError(f"{path.name}: the version of a DAT file must be 2, got '{version}'")
        with open_file(path) as file:
            file.seek(header.end)
            mark = file.read(2)
        if len(mark) < 2 or mark[0] not in _DAT_TYPES or mark[1] != _DAT_BYTES:
            raise RecordingError(
                f"{path.name}: bytes {header.end} and {header.end + 1} must be the event type 0 or 12 and "
                f"the event size 8, got {' and '.join(map(str, mark)) or 'the end of the file'}"
            )
        clock = Clock(_DAT_PERIOD_US)
        for _, read in read_words(path, header.end + 2, _DAT_BYTES, broken):
            time, word = np.frombuffer(read, dtype="<u4").reshape(-1, 2).astype(np.int64).T
            yield from block_of(clock(time), word & 0x3FFF, word >> 14 & 0x3FFF, word >> 28)


class _Evt(_Prophesee, ABC):
    """What EVT 2.0 and 3.0 share: words that hold an event, or what later ones leave out."""

    suffixes: ClassVar[tuple[str, ...]] = (".raw",)
    version: ClassVar[str]
    word_bytes: ClassVar[int]
    kinds: ClassVar[tuple[int, ...]]  # the upper 4 bits of a word
    time_highs: ClassVar[int]  # where the time high wraps
    stated: ClassVar[str]

    def matches(self, path: Path, head: bytes) -> bool:
        """Return whether the header states this version."""
        return parse(head).evt == self.version

    def blocks(self, path: Path, broken: Repairs) -> Iterator[Block]:
        """Yield the events; those whose time or place was not stated before are a fault."""
        header = _read_header(path)
        if header.evt is None:
            broken(
                f"the header must state the encoding in a line '% evt {self.version}', which is missing",
                f"reads the data after {header.end} bytes of header as EVT {self.version}",
            )
        elif header.evt != self.version:
            raise RecordingError(
                f"{path.name}: the encoding must be EVT {self.version} for this reader, got "
                f"'% evt {header.evt}'"
            )
        if (order := header.fields.get("endianness", "little")) != "little":
            raise RecordingError(f"{path.name}: endianness must be little, got '{order}'")
        size, clock, high = self.word_bytes, Clock(self.time_highs), -1
        carried: dict[str, int] = {}
        most = max(1, BLOCK_EVENTS // (_MOST_PER_WORD if size == 2 else 1))
        for start, read in read_words(path, header.end, size, broken, most):
            words = np.frombuffer(read, dtype=f"<u{size}").astype(np.int64)
            kind = words >> (8 * size - 4)
            is_high = kind == 0x8
            counted = np.zeros_like(words)
            counted[is_high] = clock(words[is_high] & (self.time_highs - 1))
            highs, before = _held(counted, is_high, high), high
            high = int(highs[-1])
            new = np.diff(highs, prepend=before) != 0
            t_us, x, y, polarity, is_stated = self._decoded(words, kind, highs, new, carried)
            n_early = int((~is_stated).sum())
            broken(
                f"events must not come before the first {self.stated}, got {n_early} from byte {start} on",
                f"drops events before the first {self.stated}",
                n_early,
            )
            unknown = ~np.isin(kind, self.kinds)
            fault = f"the word type must be one of EVT {self.version}, got {{:#x}} at byte {{}}"
            at = start + size * np.arange(len(words))
            broken.where(unknown, fault, "skips words of unknown type", kind, at)
            yield from block_of(t_us, x, y, polarity, is_stated)

    @abstractmethod
    def _decoded(
        self, words: Ints, kind: Ints, highs: Ints, new: Bools, carried: dict[str, int]
    ) -> tuple[Ints, Ints, Ints, Ints, Bools]:
        """Return t_us, x, y and polarity of the events, and whether words before stated time and place.

        words, kind: (n,) words and their upper 4 bits. highs: (n,) the time high at each, -1 before the
        first. new: (n,) whether it is another one than before. carried: what the block before stated;
        updated.
        """


@register("recordings.formats", "evt2")
@dataclass(frozen=True)
class Evt2(_Evt):
    """Prophesee EVT 2.0 (.raw); trigger and vendor-specific words are skipped."""

    version: ClassVar[str] = "2.0"
    word_bytes: ClassVar[int] = 4
    kinds: ClassVar[tuple[int, ...]] = (0x0, 0x1, 0x8, 0xA, 0xE, 0xF)  # OFF, ON, time high, others
    time_highs: ClassVar[int] = 1 << 28  # 4.8 hours
    stated: ClassVar[str] = "time high"

    def _decoded(
        self, words: Ints, kind: Ints, highs: Ints, new: Bools, carried: dict[str, int]
    ) -> tuple[Ints, Ints, Ints, Ints, Bools]:
        is_event = kind <= 1
        word, high = words[is_event], highs[is_event]
        t_us = high << 6 | word >> 22 & 0x3F
        return t_us, word >> 11 & 0x7FF, word & 0x7FF, kind[is_event], high >= 0


@register("recordings.formats", "evt3")
@dataclass(frozen=True)
class Evt3(_Evt):
    """Prophesee EVT 3.0 (.raw); trigger, continuation and vendor-specific words are skipped.

    A word says only what changed: time, row, one column, or up to 12 columns at once from a base on.
    """

    version: ClassVar[str] = "3.0"
    word_bytes: ClassVar[int] = 2
    # Row, column, vector base, vectors of 12 and 8, time low, continued, time high, others.
    kinds: ClassVar[tuple[int, ...]] = (0x0, 0x2, 0x3, 0x4, 0x5, 0x6, 0x7, 0x8, 0xA, 0xE, 0xF)
    time_highs: ClassVar[int] = 1 << 12  # 16.8 seconds
    stated: ClassVar[str] = "time high, row or vector base"

    def _decoded(
        self, words: Ints, kind: Ints, highs: Ints, new: Bools, carried: dict[str, int]
    ) -> tuple[Ints, Ints, Ints, Ints, Bools]:
        lower, upper = words & 0x7FF, words >> 11 & 1
        # A new time high clears the lower bits; cameras also repeat it between two time lows.
        lows = _held(np.where(new, 0, words & 0xFFF), (kind == 0x6) | new, carried.get("low", 0))
        rows = _held(lower, kind == 0x0, carried.get("row", -1))
        is_base = kind == 0x3
        poles = _held(upper, is_base, carried.get("pole", 0))
        width = np.where(kind == 0x4, 12, np.where(kind == 0x5, 8, 0))
        passed = np.cumsum(width)
        bases = _held(lower - passed, is_base, carried.get("base", _NO_BASE))
        column = np.where(width > 0, bases + passed - width, lower)
        carried |= {"low": lows[-1], "row": rows[-1], "pole": poles[-1], "base": bases[-1] + passed[-1]}
        valid = np.where(kind == 0x2, 1, words & (1 << width) - 1)
        holds = np.flatnonzero((kind == 0x2) | (width > 0))
        place, bit = np.nonzero(valid[holds, None] >> np.arange(_MOST_PER_WORD) & 1)
        word = holds[place]
        is_stated = (highs[word] >= 0) & (rows[word] >= 0) & (column[word] >= 0)
        polarity = np.where(width > 0, poles, upper)
        return highs[word] << 12 | lows[word], column[word] + bit, rows[word], polarity[word], is_stated


def _held(values: Ints, stated: Bools, before: int) -> Ints:
    """Return at every word the value that was stated last, up to and with it; `before` where none was."""
    last = np.maximum.accumulate(np.where(stated, np.arange(1, len(values) + 1), 0))
    return np.concatenate([[before], values])[last]
