"""AEDAT 3.1, the files of cAER: a text header, then packets of events of one type each."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, ClassVar

import numpy as np

from dse.recordings import RecordingError
from dse.recordings.formats import BLOCK_EVENTS, Broken, open_file
from dse.recordings.formats.aedat import LINE_BYTES, chip_frame, read_version
from dse.records import Block
from dse.registry import register

_PACKET = struct.Struct("<hhiiiiii")
_POLARITY = 1
_EVENT = np.dtype([("data", "<u4"), ("t", "<i4")])
_END = b"#!END-HEADER"


@register("recordings.formats", "aedat31")
@dataclass(frozen=True)
class Aedat31:
    """AEDAT 3.1: polarity events of the first source that has any.

    Packets of other types or sources, and events that are marked as invalid, are passed over. A time is the
    event's 31 bits below the packet's overflow counter; after a reset of the camera's clock times begin anew.

    Source: iniVation, AEDAT File Formats, AEDAT 3.1.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".aedat", ".aedat3")

    def matches(self, path: Path, head: bytes) -> bool:
        """Return whether the head names version 3; of its revisions all but 3.1 are refused with a reason."""
        return head.startswith(b"#!AER-DAT3")

    def frame(self, path: Path) -> tuple[int, int] | None:
        """Return the size of the chip that is the source, None if it is not known or sources differ.

        Raises:
            RecordingError: the header is not of this format.
        """
        with open_file(path) as file:
            sizes = {chip_frame(chip) for chip in _read_header(file, path.name)}
        return sizes.pop() if len(sizes) == 1 else None

    def blocks(self, path: Path, broken: Broken) -> Iterator[Block]:
        """Yield the events.

        Raises:
            RecordingError: the header is not of this format, or `broken` raised it.
        """
        with open_file(path) as file:
            _read_header(file, path.name)
            camera = None
            for packet in _packets(file, broken):
                if packet.kind != _POLARITY or not packet.n or camera not in (None, packet.source):
                    continue
                if (packet.size, packet.time_at) != (_EVENT.itemsize, 4):
                    broken(
                        f"the polarity events of the packet at byte {packet.at} must be 8 bytes long with "
                        f"the time at byte 4, got {packet.size} bytes with the time at byte {packet.time_at}",
                        "drops packets of polarity events with another layout",
                    )
                    continue
                camera = packet.source
                yield from _events(file, packet)


@dataclass(frozen=True)
class _Packet:
    """The header of a packet: where it is, what it holds, and the layout of its n events."""

    at: int
    kind: int
    source: int
    size: int
    time_at: int
    overflow: int
    n: int


def _read_header(file: BinaryIO, name: str) -> list[str]:
    """Read up to the first packet; return the names of the sources."""
    read_version(file, name, "3.1")
    sources: list[str] = []
    while True:
        at = file.tell()
        line = file.readline(LINE_BYTES)
        if line.rstrip(b"\r\n") == _END:
            return sources
        if not line.startswith(b"#"):
            got = f"{line[:16]!r}" if line else "the end of the file"
            raise RecordingError(
                f"{name}: the header must end with the line '{_END.decode()}', got {got} at byte {at}"
            )
        key, _, value = line.decode(errors="replace").partition(":")
        if key == "#Format" and value.strip() != "RAW":
            raise RecordingError(
                f"{name}: the header's Format must be RAW, got '{value.strip()}' at byte {at}"
            )
        if key.startswith("#Source "):
            sources.append(value.strip())


def _packets(file: BinaryIO, broken: Broken) -> Iterator[_Packet]:
    """Yield the packets, with the file at the first event of each."""
    end = os.fstat(file.fileno()).st_size
    while (at := file.tell()) < end:
        head = file.read(_PACKET.size)
        if len(head) < _PACKET.size:
            broken(
                f"the packet header at byte {at} must have {_PACKET.size} bytes, "
                f"but the file ends after {len(head)}",
                "drops a truncated packet header",
            )
            return
        kind, source, size, time_at, overflow, capacity, n, valid = _PACKET.unpack(head)
        sound = kind >= 0 and source >= 0 and overflow >= 0 and 0 <= valid <= n == capacity
        if not sound or not 0 <= time_at <= size - 4:
            broken(
                f"the packet header at byte {at} must hold sizes of an event and of a packet that is full, "
                f"got type {kind}, source {source}, {size} bytes per event with the time at byte {time_at}, "
                f"overflow {overflow}, {n} events, {valid} of them valid, and room for {capacity}",
                "drops the bytes after an invalid packet header",
                end - at,
            )
            return
        begin = at + _PACKET.size
        whole = min(n, (end - begin) // size)
        if whole < n:
            broken(
                f"the packet at byte {at} must hold {n} events of {size} bytes, but the file ends after "
                f"{whole} of them",
                "drops the events of a truncated packet",
                n - whole,
            )
        yield _Packet(at, kind, source, size, time_at, overflow, whole)
        file.seek(begin + n * size)


def _events(file: BinaryIO, packet: _Packet) -> Iterator[Block]:
    """Yield the valid events of a packet.

    Bits 31-17 column, 16-2 row, 1 polarity, 0 validity; (0, 0) is the upper left pixel.
    """
    for first in range(0, packet.n, BLOCK_EVENTS):
        count = min(BLOCK_EVENTS, packet.n - first)
        events = np.frombuffer(file.read(count * _EVENT.itemsize), _EVENT)
        events = events[events["data"] & 1 == 1]
        data = events["data"]
        if len(events):
            yield Block(
                (packet.overflow << 31) + events["t"].astype(np.int64),
                (data >> 17).astype(np.int32),
                (data >> 2 & 0x7FFF).astype(np.int32),
                (data >> 1 & 1).astype(np.uint8),
            )
