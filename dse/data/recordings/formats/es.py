"""Event Stream 2.0 (.es): events of five bytes, each with the time since the one before."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, ClassVar

import numpy as np

from dse.base.records import Block
from dse.base.registry import register
from dse.data.recordings import RecordingError
from dse.data.recordings.formats import BLOCK_EVENTS, Format, Repairs, block_of, open_file

_MARK = b"Event Stream"
_HEADER_BYTES = 20
_EVENT_BYTES = 5
_KINDS = ("generic", "DVS", "ATIS", "display", "colour")
_FLAGS = {"DVS": 1, "ATIS": 2}  # bits of an event's first byte that are not time
# Bytes of elapsed time alone, whose time bits are all set; an event; what is left of a cut one.
_TOKENS = {
    1: re.compile(rb"([\xfe\xff]+)|([^\xfe\xff].{4})|(.+)", re.DOTALL),
    2: re.compile(rb"([\xfc-\xff]+)|([^\xfc-\xff].{4})|(.+)", re.DOTALL),
}


@register("recordings.formats", "es")
@dataclass(frozen=True)
class EventStream(Format):
    """Event Stream 2.0 of DVS or ATIS events; of ATIS only the changes, not the threshold crossings.

    Rows are counted from the bottom in these files; here (0, 0) is the upper left pixel, as in other formats.

    Source: the Event Stream specification, version 2.0; the direction of rows is that of its authors' tools.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".es",)
    marks: ClassVar[tuple[bytes, ...]] = (_MARK,)

    def frame(self, path: Path) -> tuple[int, int]:
        """Return the width and height that the header states; events without addresses are an error."""
        with open_file(path) as file:
            return _read_header(file, path.name)[1:]

    def blocks(self, path: Path, broken: Repairs) -> Iterator[Block]:
        """Yield the events.

        The lowest bits of an event's first byte are flags (polarity; threshold crossing), the others the
        elapsed time; a byte whose time bits are all set is no event but lets that much time pass, as many
        times as its flags say.
        """
        with open_file(path) as file:
            flags, _, height = _read_header(file, path.name)
            full, lowest = 255 >> flags, (1 << flags) - 1
            at, time, rest = _HEADER_BYTES, 0, b""
            while read := file.read(BLOCK_EVENTS * _EVENT_BYTES):
                tokens = _TOKENS[flags].findall(rest + read)
                rest = tokens[-1][2]
                at += sum(len(alone) + len(event) for alone, event, _ in tokens)
                passed = [event[0] >> flags if event else full * sum(x & lowest for x in alone)
                          for alone, event, _ in tokens]  # fmt: skip
                t_us = time + np.cumsum(passed)
                time = int(t_us[-1])
                events = np.frombuffer(b"".join(event for _, event, _ in tokens), np.uint8)
                first, x0, x1, y0, y1 = events.reshape(-1, _EVENT_BYTES).astype(np.int64).T
                is_change = (flags == 1) | (first & 1 == 0)
                yield from block_of(
                    t_us[[bool(event) for _, event, _ in tokens]],
                    x0 | x1 << 8,
                    height - 1 - (y0 | y1 << 8),
                    first >> (flags - 1) & 1,
                    is_change,
                )
            broken(
                f"the event at byte {at} must have {_EVENT_BYTES} bytes, but the file ends after {len(rest)}",
                "drops a truncated event",
                int(len(rest) > 0),
            )


def _read_header(file: BinaryIO, name: str) -> tuple[int, int, int]:
    """Read up to the first event; return the number of flags of an event, and the width and height."""
    head = file.read(_HEADER_BYTES)
    if not head.startswith(_MARK):
        got = f"begins with {head[: len(_MARK)]!r}" if head else "is empty"
        raise RecordingError(f"{name}: the file must begin with '{_MARK.decode()}' at byte 0, it {got}")
    if head[12:14] != b"\x02\x00" and len(head) > 14:
        raise RecordingError(
            f"{name}: the version at byte 12 must be 2.0, got {'.'.join(str(x) for x in head[12:15])}"
        )
    kind = dict(enumerate(_KINDS)).get(head[15], str(head[15])) if len(head) > 15 else ""
    if kind and kind not in _FLAGS:
        raise RecordingError(
            f"{name}: the type at byte 15 must be DVS or ATIS, whose events have addresses, got {kind} events"
        )
    if len(head) < _HEADER_BYTES:
        raise RecordingError(f"{name}: the header must be {_HEADER_BYTES} bytes long, got {len(head)}")
    width, height = int.from_bytes(head[16:18], "little"), int.from_bytes(head[18:20], "little")
    if not width or not height:
        raise RecordingError(f"{name}: the frame at byte 16 must be at least 1 x 1, got {width} x {height}")
    return _FLAGS[kind], width, height
