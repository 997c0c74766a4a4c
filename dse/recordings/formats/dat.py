"""Prophesee DAT, version 2: 8 bytes per event, a 32-bit time and a word of column, row and polarity."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from dse.recordings import RecordingError
from dse.recordings.formats import Broken, open_file, prophesee
from dse.recordings.formats.words import read_words, unwrapped
from dse.records import Block
from dse.registry import register

_VERSION = "2"
_EVENT_TYPES = (0x00, 0x0C)  # 2D events as written by old and by new cameras
_EVENT_BYTES = 8
_PERIOD_US = 1 << 32  # 1.2 hours


@register("recordings.formats", "dat")
@dataclass(frozen=True)
class Dat:
    """Prophesee DAT version 2 (.dat); its 32-bit time may wrap."""

    suffixes: ClassVar[tuple[str, ...]] = (".dat",)

    def matches(self, path: Path, head: bytes) -> bool:
        """Return whether a header and the type and size of CD events are there."""
        header = prophesee.parse(head)
        mark = head[header.end : header.end + 2]
        typed = len(mark) == 2 and mark[0] in _EVENT_TYPES and mark[1] == _EVENT_BYTES
        return header.end > 0 and header.evt is None and (typed or "version" in header.fields)

    def frame(self, path: Path) -> tuple[int, int] | None:
        """Return the width and height that the header states, if it does."""
        return prophesee.read_header(path).frame

    def blocks(self, path: Path, broken: Broken) -> Iterator[Block]:
        """Yield the events.

        Raises:
            RecordingError: as `Format.blocks`, or the file holds other events than CD events of version 2.
        """
        header = prophesee.read_header(path)
        version = header.fields.get("version")
        if version is None:
            broken(
                "the header must state the version in a line '% Version 2', which is missing",
                f"reads the data after {header.end} bytes of header as version 2",
            )
        elif version != _VERSION:
            raise RecordingError(f"{path.name}: the version of a DAT file must be 2, got '{version}'")
        with open_file(path) as file:
            file.seek(header.end)
            mark = file.read(2)
        if len(mark) < 2 or mark[0] not in _EVENT_TYPES or mark[1] != _EVENT_BYTES:
            raise RecordingError(
                f"{path.name}: bytes {header.end} and {header.end + 1} must be the event type 0 or 12 and "
                f"the event size 8, got {' and '.join(map(str, mark)) or 'the end of the file'}"
            )
        before = 0
        for read in read_words(path, header.end + 2, _EVENT_BYTES, broken):
            words = np.frombuffer(read, dtype="<u4").reshape(-1, 2).astype(np.int64)
            t_us = unwrapped(words[:, 0], before, _PERIOD_US)
            before = int(t_us[-1])
            x, y = (words[:, 1] & 0x3FFF).astype(np.int32), (words[:, 1] >> 14 & 0x3FFF).astype(np.int32)
            yield Block(t_us, x, y, (words[:, 1] >> 28).astype(np.uint8))
