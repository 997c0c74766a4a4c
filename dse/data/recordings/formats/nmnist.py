"""The 40-bit events of N-MNIST: column, row, a bit of polarity and 23 bits of time, no header."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from dse.base.records import Block
from dse.base.registry import register
from dse.data.recordings.formats import Clock, Format, Repairs, block_of, open_file, read_words

_EVENT_BYTES = 5
_FRAME = (34, 34)
_PERIOD_US = 1 << 23  # 8.4 seconds
_MARK_ROW = 240
_MARK_US = 1 << 13


@register("recordings.formats", "nmnist")
@dataclass(frozen=True)
class Nmnist(Format):
    """N-MNIST (.bin), 34 x 34 pixels, and N-Caltech101, whose frame must be given.

    Time: an entry of row 240 is no event but adds 8192 us to all later times, as the data set's own reader
    does; a fall of the 23 bits by more than 7/8 of their range is a wrap.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".bin",)

    def matches(self, path: Path, head: bytes) -> bool:
        """Return whether the name ends in .bin and all events of the first 4 KiB lie in N-MNIST's frame."""
        return path.suffix.lower() in self.suffixes and len(head) > 0 and _inside(head)

    def frame(self, path: Path) -> tuple[int, int] | None:
        """Return N-MNIST's frame if the events of the first 4 KiB lie in it; no file states its own."""
        with open_file(path) as file:
            return _FRAME if _inside(file.read(4096)) else None

    def blocks(self, path: Path, broken: Repairs) -> Iterator[Block]:
        """Yield the events."""
        clock, marks = Clock(_PERIOD_US), 0
        for _, read in read_words(path, 0, _EVENT_BYTES, broken):
            x, y, *rest = np.frombuffer(read, np.uint8).reshape(-1, _EVENT_BYTES).astype(np.int64).T
            t_us = clock((rest[0] & 0x7F) << 16 | rest[1] << 8 | rest[2])
            passed = marks + np.cumsum(y == _MARK_ROW)
            marks = int(passed[-1])
            yield from block_of(t_us + passed * _MARK_US, x, y, rest[0] >> 7, y != _MARK_ROW)


def _inside(head: bytes) -> bool:
    """Return whether all whole events of the first bytes lie in N-MNIST's frame."""
    whole = head[: len(head) // _EVENT_BYTES * _EVENT_BYTES]
    columns, rows = whole[::_EVENT_BYTES], whole[1::_EVENT_BYTES]
    return all(x < _FRAME[0] for x in columns) and all(y < _FRAME[1] or y == _MARK_ROW for y in rows)
