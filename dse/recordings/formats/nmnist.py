"""The 40-bit events of N-MNIST: column, row, a bit of polarity and 23 bits of time, no header."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from dse.recordings.formats import Broken, open_file
from dse.recordings.formats.words import read_words, unwrapped
from dse.records import Block
from dse.registry import register

_EVENT_BYTES = 5
_FRAME = (34, 34)
_PERIOD_US = 1 << 23  # 8.4 seconds
_MARK_ROW = 240
_MARK_US = 1 << 13


@register("recordings.formats", "nmnist")
@dataclass(frozen=True)
class Nmnist:
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

    def blocks(self, path: Path, broken: Broken) -> Iterator[Block]:
        """Yield the events."""
        before, marks = 0, 0
        for read in read_words(path, 0, _EVENT_BYTES, broken):
            words = np.frombuffer(read, dtype=np.uint8).reshape(-1, _EVENT_BYTES).astype(np.int64)
            x, y = words[:, 0].astype(np.int32), words[:, 1].astype(np.int32)
            t_us = unwrapped((words[:, 2] & 0x7F) << 16 | words[:, 3] << 8 | words[:, 4], before, _PERIOD_US)
            before = int(t_us[-1])
            mark = y == _MARK_ROW
            passed = marks + np.cumsum(mark)
            marks = int(passed[-1])
            t_us = t_us + passed * _MARK_US
            event = ~mark
            polarity = (words[:, 2] >> 7).astype(np.uint8)
            if event.any():
                yield Block(t_us[event], x[event], y[event], polarity[event])


def _inside(head: bytes) -> bool:
    """Return whether all whole events of the first bytes lie in N-MNIST's frame."""
    whole = head[: len(head) // _EVENT_BYTES * _EVENT_BYTES]
    columns, rows = whole[::_EVENT_BYTES], whole[1::_EVENT_BYTES]
    return all(x < _FRAME[0] for x in columns) and all(y < _FRAME[1] or y == _MARK_ROW for y in rows)
