"""Event Stream 2.0 (.es): events of five bytes, each with the time since the one before."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, ClassVar

import numpy as np

from dse.recordings import RecordingError
from dse.recordings.formats import BLOCK_EVENTS, Broken, open_file
from dse.records import Block
from dse.registry import register

_MARK = b"Event Stream"
_HEADER_BYTES = 20
_EVENT_BYTES = 5
_KINDS = ("generic", "DVS", "ATIS", "display", "colour")
_FLAGS = {"DVS": 1, "ATIS": 2}  # bits of an event's first byte that are not time


@register("recordings.formats", "es")
@dataclass(frozen=True)
class EventStream:
    """Event Stream 2.0 of DVS or ATIS events; of ATIS only the changes, not the threshold crossings.

    Rows are counted from the bottom in these files; here (0, 0) is the upper left pixel, as in other formats.

    Source: the Event Stream specification, version 2.0; the direction of rows is that of its authors' tools.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".es",)

    def matches(self, path: Path, head: bytes) -> bool:
        """Return whether the head bears the format's mark, whatever version and type."""
        return head.startswith(_MARK)

    def frame(self, path: Path) -> tuple[int, int]:
        """Return the width and height that the header states.

        Raises:
            RecordingError: the header is not sound, or of events without addresses.
        """
        with open_file(path) as file:
            _, width, height = _read_header(file, path.name)
        return width, height

    def blocks(self, path: Path, broken: Broken) -> Iterator[Block]:
        """Yield the events.

        Raises:
            RecordingError: the header is not sound, the events have no addresses, or `broken` raised it.
        """
        from dse.recordings.formats.kernels.es import decode

        with open_file(path) as file:
            flags, _, height = _read_header(file, path.name)
            at, time, rest = _HEADER_BYTES, 0, b""
            while read := file.read(BLOCK_EVENTS * _EVENT_BYTES):
                data = np.frombuffer(rest + read, np.uint8)
                most = len(data) // _EVENT_BYTES
                t_us, polarity = np.empty(most, np.int64), np.empty(most, np.uint8)
                x, y = np.empty(most, np.int32), np.empty(most, np.int32)
                n, taken, time = decode(data, time, flags, t_us, x, y, polarity)
                at, rest = at + taken, data[taken:].tobytes()
                if n:
                    yield Block(t_us[:n], x[:n], height - 1 - y[:n], polarity[:n])
            if rest:
                broken(
                    f"the event at byte {at} must have {_EVENT_BYTES} bytes, but the file ends after "
                    f"{len(rest)}",
                    "drops a truncated event",
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
