"""AEDAT 4, the files of DV: a header, then compressed flatbuffers that belong to several streams."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, ClassVar
from xml.etree import ElementTree

import numpy as np

from dse.base.records import Array, Block
from dse.base.registry import register
from dse.data.recordings import RecordingError
from dse.data.recordings.formats import BLOCK_EVENTS, Format, Repairs, block_of, open_file
from dse.data.recordings.formats.aedat import read_version

_PACKET = struct.Struct("<ii")
_EVENT = np.dtype(
    {
        "names": ["t", "x", "y", "on"],
        "formats": ["<i8", "<i2", "<i2", "u1"],
        "offsets": [0, 8, 10, 12],
        "itemsize": 16,
    }
)
_CODECS = (None, "lz4", "lz4", "zstd", "zstd")
"""In the order of the header's number: none, LZ4, LZ4 high, Zstandard, Zstandard high."""
_PIECE_BYTES = 1 << 20
_MOST_BYTES = 1 << 28
"""Largest packet, before and after decompression: 16 million events; cameras send some thousand."""


@register("recordings.formats", "aedat4")
@dataclass(frozen=True)
class Aedat4(Format):
    """AEDAT 4: the first stream of events (type EVTS) in the header; packets of other streams are skipped.

    Times are Unix times; (0, 0) is the upper left pixel.

    Source: iniVation, AEDAT File Formats, AEDAT 4.0, and its flatbuffer schemas.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".aedat4",)
    marks: ClassVar[tuple[bytes, ...]] = (b"#!AER-DAT4",)

    def frame(self, path: Path) -> tuple[int, int] | None:
        """Return the size that the header states for the stream of events, None if it states none."""
        with open_file(path) as file:
            return _read_header(file, path.name).frame

    def blocks(self, path: Path, broken: Repairs) -> Iterator[Block]:
        """Yield the events; the packets that no flatbuffer of events is in are a fault."""
        with open_file(path) as file:
            header = _read_header(file, path.name)
            for at, data in _packets(file, header, broken):
                try:
                    events = _events(_decompressed(data, header.codec))
                except ValueError as problem:
                    broken(f"the packet at byte {at} {problem}", "drops invalid packets")
                    continue
                for first in range(0, len(events), BLOCK_EVENTS):
                    part = events[first : first + BLOCK_EVENTS]
                    yield from block_of(part["t"], part["x"], part["y"], part["on"])


@dataclass(frozen=True)
class _Header:
    """What the header says.

    codec: of the packets, None if they are not compressed.
    end: where the packets end, -1 if that is not noted.
    streams: the numbers of the streams.
    stream: the number of the events' stream.
    frame: its width and height, None if not noted.
    """

    codec: str | None
    end: int
    streams: tuple[int, ...]
    stream: int
    frame: tuple[int, int] | None


def _read_header(file: BinaryIO, name: str) -> _Header:
    """Read up to the first packet."""
    read_version(file, name, "4.0")
    at, left = file.tell(), os.fstat(file.fileno()).st_size - file.tell()
    size = int.from_bytes(file.read(4), "little")
    if not 8 <= size <= min(left - 4, _MOST_BYTES):
        raise RecordingError(
            f"{name}: the header at byte {at} must state its length within the {left} bytes left, got {size}"
        )
    data = size.to_bytes(4, "little") + file.read(size)
    try:
        fields = _root(data, b"IOHE")
        compression = _at(data, fields[0], "<i") if 0 in fields else 0
        end = _at(data, fields[1], "<q") if 1 in fields else -1
        if 2 not in fields:
            raise ValueError("must describe the streams, got no description")
        first, count = _vector(data, fields[2], 1)
        streams = _streams(data[first : first + count])
        if compression not in range(len(_CODECS)):
            most = len(_CODECS) - 1
            raise ValueError(f"must state a compression from 0 (none) to {most}, got {compression}")
        events = [stream for stream, (kind, _) in streams.items() if kind == "EVTS"]
        if not events:
            got = ", ".join(f"{stream} of type {kind}" for stream, (kind, _) in streams.items()) or "none"
            raise ValueError(f"must describe a stream of type EVTS, got {got}")
    except ValueError as problem:
        raise RecordingError(f"{name}: the header at byte {at} {problem}") from problem
    return _Header(_CODECS[compression], end, tuple(streams), events[0], streams[events[0]][1])


def _streams(text: bytes) -> dict[int, tuple[str, tuple[int, int] | None]]:
    """Return number -> type, size of the streams that XML describes, in its order."""
    streams = {}
    try:
        for node in ElementTree.fromstring(text).findall("./node[@name='outInfo']/node"):
            kind = node.findtext("attr[@key='typeIdentifier']", "")
            sides = [node.findtext(f"node[@name='info']/attr[@key='{key}']") for key in ("sizeX", "sizeY")]
            size = (int(sides[0]), int(sides[1])) if sides[0] and sides[1] else None
            if size is not None and min(size) < 1:
                raise ValueError(f"a stream must be at least 1 x 1, got {size[0]} x {size[1]}")
            streams[int(node.get("name", ""))] = (kind, size)
    except (ElementTree.ParseError, ValueError) as problem:
        raise ValueError(f"must describe the streams in XML: {problem}") from problem
    return streams


def _packets(file: BinaryIO, header: _Header, broken: Repairs) -> Iterator[tuple[int, bytes]]:
    """Yield position and content of the packets of the stream of events."""
    length = end = os.fstat(file.fileno()).st_size
    if header.end != -1:
        is_within = file.tell() <= header.end <= length
        end = header.end if is_within else length
        broken(
            f"the table of packets must begin between byte {file.tell()} and the end of the file at byte "
            f"{length}, got byte {header.end}",
            "reads the packets that are present",
            int(not is_within),
        )
    while (at := file.tell()) < end:
        head = file.read(_PACKET.size)
        stream, size = _PACKET.unpack(head) if len(head) == _PACKET.size else (-1, -1)
        begin = at + _PACKET.size
        if not 0 <= size <= end - begin:
            got = f"a length of {size} bytes" if len(head) == _PACKET.size else "no length"
            broken(
                f"the packet at byte {at} must end within the {end - at} bytes left, got {got}",
                "drops the bytes of an unfinished packet",
                end - at,
            )
            return
        broken(
            f"the packet at byte {at} must be of a stream in the header "
            f"({', '.join(map(str, header.streams))}), got stream {stream}",
            "drops packets of unknown streams",
            int(stream not in header.streams),
        )
        if stream == header.stream:
            broken(
                f"the packet at byte {at} must be at most {_MOST_BYTES} bytes long, got {size}",
                "drops packets that are too long",
                int(size > _MOST_BYTES),
            )
            if size <= _MOST_BYTES:
                yield at, file.read(size)
        file.seek(begin + size)


def _events(data: bytes) -> Array:
    """Return the events of a packet, a view into it."""
    fields = _root(data, b"EVTS")
    if 0 not in fields:
        return np.empty(0, _EVENT)
    first, count = _vector(data, fields[0], _EVENT.itemsize)
    return np.frombuffer(data, _EVENT, count, first)


def _root(data: bytes, kind: bytes) -> dict[int, int]:
    """Return number -> position of the fields that the root table of a size-prefixed flatbuffer holds."""
    if len(data) < 12 or int.from_bytes(data[:4], "little") != len(data) - 4:
        raise ValueError(f"must hold a flatbuffer of its own length, got {len(data)} bytes")
    if data[8:12] != kind:
        raise ValueError(f"must hold a flatbuffer {kind.decode()}, got {data[8:12]!r}")
    table = 4 + _at(data, 4, "<I")
    lookup = table - _at(data, table, "<i")
    if (size := _at(data, lookup, "<H")) < 4:
        raise ValueError(f"must hold a table of at least 4 bytes, got {size}")
    offsets = [_at(data, place, "<H") for place in range(lookup + 4, lookup + size - 1, 2)]
    return {i: table + offset for i, offset in enumerate(offsets) if offset}


def _vector(data: bytes, at: int, size: int) -> tuple[int, int]:
    """Return the position of the first item, and the number of items, of the vector of the field at `at`."""
    begin = at + _at(data, at, "<I")
    count = _at(data, begin, "<I")
    if begin + 4 + count * size > len(data):
        raise ValueError(f"must hold {count} items of {size} bytes, got {len(data) - begin - 4} bytes")
    return begin + 4, count


def _at(data: bytes, at: int, layout: str) -> int:
    if not 0 <= at <= len(data) - struct.calcsize(layout):
        raise ValueError(f"must refer to positions within its {len(data)} bytes, got {at}")
    return int(struct.unpack_from(layout, data, at)[0])


def _decompressed(data: bytes, codec: str | None) -> bytes:
    """Return what was compressed."""
    if codec is None:
        return data
    import pyarrow

    found = bytearray()
    try:
        with pyarrow.CompressedInputStream(pyarrow.BufferReader(data), codec) as stream:
            while piece := stream.read(_PIECE_BYTES):
                found += piece
                if len(found) > _MOST_BYTES:
                    raise ValueError(f"must hold at most {_MOST_BYTES} bytes after decompression, got more")
    except OSError as problem:
        raise ValueError(f"must be compressed as {codec}: {problem}") from problem
    return bytes(found)
