"""ST-MNIST recordings: the matrix `spiketrain` of a MATLAB v5 file, a column per event.

    spiketrain (101, n): rows 0-99 the taxels, -1 (OFF), 0 or 1 (ON); row 100 the time in seconds

Taxel k is column k mod 10 of row k div 10. Every non-zero entry is an event at its column's time, rounded to
the microsecond. The matrix is stored column by column: it is inflated and read in blocks, and never in memory
as a whole. scipy.io.loadmat is no substitute: one wrong byte in a type code makes it crash the interpreter
(scipy 1.17), it returns nothing of a truncated file, and it allocates what a header declares.

Sources: See et al., ST-MNIST, arXiv:2005.04319; MathWorks, MAT-File Format, chapter 1 (version 5).
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, ClassVar

import numpy as np

from dse.recordings import RecordingError
from dse.recordings.formats import Broken, open_file
from dse.records import Array, Block
from dse.registry import register

VARIABLE = "spiketrain"
SIDE = 10
N_ROWS = SIDE * SIDE + 1

Read = Callable[[int], bytes]
"""Return up to n bytes; none at the end of the file."""
Number = np.dtype[Any]

_HEADER = 128
_MATRIX, _COMPRESSED = 14, 15
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_NUMERIC_CLASSES = range(6, 16)
_COMPLEX = 0x08
_LONGEST_PART = 1 << 10
_LATEST_S = 1e12
_COLUMNS = 1 << 12
_CHUNK = 1 << 16


class _Cut(Exception):
    """The file ends, or its compressed bytes are damaged, before the end of the matrix."""


@register("recordings.formats", "stmnist")
@dataclass(frozen=True)
class Stmnist:
    """ST-MNIST: `spiketrain` of a MATLAB v5 .mat file, 10 x 10 taxels."""

    suffixes: ClassVar[tuple[str, ...]] = (".mat",)

    def matches(self, path: Path, head: bytes) -> bool:
        """Return whether the head is that of a MATLAB file."""
        return head.startswith((b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file"))

    def frame(self, path: Path) -> tuple[int, int]:
        """Return the taxels along x and y.

        Raises:
            RecordingError: the file is of another version, or has no such matrix.
        """
        with open_file(path) as file:
            _matrix(file, path.name)
        return SIDE, SIDE

    def blocks(self, path: Path, broken: Broken) -> Iterator[Block]:
        """Yield the events; `broken` hears of columns that have no time, and of a truncated matrix.

        Raises:
            RecordingError: the file cannot be opened or holds no such matrix, or `broken` raised it.
        """
        with open_file(path) as file:
            n_columns, number, stream = _matrix(file, path.name)
            for first in range(0, n_columns, _COLUMNS):
                n = min(_COLUMNS, n_columns - first)
                columns, whole = _columns(stream.read, n, number)
                yield from _events(columns, first, broken)
                if not whole:
                    broken(
                        f"truncated or damaged at byte {file.tell()}, in column {first + len(columns)} "
                        f"of {n_columns}",
                        "keeps the events before the damage",
                    )
                    return
            if not _ends_well(stream):
                broken(
                    f"the checksum of {VARIABLE} must match its bytes",
                    "keeps events that may be wrong",
                )


def _events(columns: Array, first: int, broken: Broken) -> Iterator[Block]:
    time_s, values = columns[:, -1].astype(np.float64), columns[:, :-1]
    sound = (np.abs(time_s) < _LATEST_S) & np.isfinite(values).all(axis=1)
    if not sound.all():
        at = int(sound.argmin())
        broken(
            f"column {first + at} must hold numbers and a time in seconds, got the time {time_s[at]:g}",
            "drops columns without a time or with values that are not numbers",
            int((~sound).sum()),
        )
        time_s, values = time_s[sound], values[sound]
    column, taxel = np.nonzero(values)
    if len(column):
        yield Block(
            t_us=np.rint(time_s[column] * 1e6).astype(np.int64),
            x=(taxel % SIDE).astype(np.int32),
            y=(taxel // SIDE).astype(np.int32),
            polarity=(values[column, taxel] > 0).astype(np.uint8),
        )


def _columns(read: Read, n: int, number: Number) -> tuple[Array, bool]:
    """Return up to n columns as (columns, 101) numbers, and whether all n were there."""
    column_bytes = N_ROWS * number.itemsize
    left, parts = n * column_bytes, []
    while left and (part := read(min(left, _CHUNK))):
        parts.append(part)
        left -= len(part)
    data = b"".join(parts)
    whole = len(data) // column_bytes
    return np.frombuffer(data[: whole * column_bytes], number).reshape(-1, N_ROWS), not left


def _matrix(file: BinaryIO, name: str) -> tuple[int, Number, BinaryIO | _Inflated]:
    """Return the number of columns of the matrix, its number type, and the stream of its values.

    Raises:
        RecordingError: another version, no such matrix, or one of another shape or kind.
    """
    header = file.read(_HEADER)
    if header.startswith(b"MATLAB 7.3"):
        raise RecordingError(f"{name}: must be a MATLAB file of version 5 to 7, got 7.3; save it with -v7")
    order = {b"IM": "<", b"MI": ">"}.get(header[126:128])
    if order is None:
        raise RecordingError(f"{name}: must be a MATLAB v5 file, got a truncated or different header")
    known = []
    while tag := file.read(8):
        try:
            if len(tag) < 8:
                raise _Cut
            kind, size = struct.unpack(f"{order}II", tag)
            end = file.tell() + size
            stream: BinaryIO | _Inflated = file
            if kind == _COMPRESSED:
                stream = _Inflated(file, size)
                kind, size = struct.unpack(f"{order}II", _exactly(stream.read, 8))
            if kind == _MATRIX:
                variable, fault, n_columns = _about(stream.read, order)
                if variable == VARIABLE and fault:
                    raise RecordingError(f"{name}: {VARIABLE} must be {N_ROWS} x n real numbers, got {fault}")
                if variable == VARIABLE:
                    return n_columns, _number(stream.read, order, n_columns), stream
                known.append(variable)
        except _Cut:
            raise RecordingError(f"{name}: truncated or damaged at byte {file.tell()}, in a header") from None
        file.seek(end)
    raise RecordingError(f"{name}: has no matrix '{VARIABLE}'; it has {', '.join(known) or 'nothing'}")


def _about(read: Read, order: str) -> tuple[str, str, int]:
    """Return the name of a matrix, what is wrong with its kind or shape ('' if nothing), and its columns."""
    flags = struct.unpack(f"{order}I", _part(read, order)[:4].ljust(4, b"\0"))[0]
    shape_bytes = _part(read, order)
    shape = struct.unpack(f"{order}{len(shape_bytes) // 4}i", shape_bytes[: len(shape_bytes) // 4 * 4])
    variable = _part(read, order).decode("latin-1")
    if variable and not variable.isidentifier():
        raise _Cut
    if flags & 0xFF not in _NUMERIC_CLASSES or (flags >> 8) & _COMPLEX:
        return variable, "values of another type", 0
    if len(shape) != 2 or shape[0] != N_ROWS or shape[1] < 0:
        return variable, " x ".join(map(str, shape)), 0
    return variable, "", shape[1]


def _part(read: Read, order: str) -> bytes:
    """Return the bytes of the next small element of a matrix."""
    first, size = struct.unpack(f"{order}II", tag := _exactly(read, 8))
    if first >> 16:  # up to four bytes lie in the tag itself
        return tag[4 : 4 + (first >> 16)]
    if size > _LONGEST_PART:
        raise _Cut
    return _exactly(read, -(-size // 8) * 8)[:size]


def _number(read: Read, order: str, n_columns: int) -> Number:
    """Return the type of the values: MATLAB stores them in the smallest type that holds them all."""
    kind, size = struct.unpack(f"{order}II", _exactly(read, 8))
    number = np.dtype(order + _NUMBERS.get(kind, "V0"))
    if not number.itemsize or size != N_ROWS * n_columns * number.itemsize:
        raise _Cut
    return number


def _exactly(read: Read, n: int) -> bytes:
    data = b""
    while len(data) < n:
        if not (part := read(n - len(data))):
            raise _Cut
        data += part
    return data


def _ends_well(stream: BinaryIO | _Inflated) -> bool:
    """Return whether the check sum behind a compressed matrix, if it is one, is right."""
    if not isinstance(stream, _Inflated):
        return True
    while stream.read(_CHUNK):
        pass
    return stream.whole


class _Inflated:
    """The bytes of a zlib stream inside a file, inflated on request; the stream ends where it is damaged."""

    def __init__(self, file: BinaryIO, size: int) -> None:
        self._file, self._left = file, size
        self._stream = zlib.decompressobj()

    @property
    def whole(self) -> bool:
        """Whether the stream was read to its end and its check sum is right."""
        return self._stream.eof

    def read(self, n: int) -> bytes:
        """Return up to n bytes, none at the end."""
        while not self._stream.eof:
            packed = self._stream.unconsumed_tail
            if not packed:
                packed = self._file.read(min(self._left, _CHUNK))
                self._left -= len(packed)
            try:
                data = self._stream.decompress(packed, n)
            except zlib.error:
                return b""
            if data or not packed:
                return data
        return b""
