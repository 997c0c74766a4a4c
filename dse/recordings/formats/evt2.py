"""Prophesee EVT 2.0: one 32-bit word per event, or with the upper bits of the time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from dse.recordings.formats import Broken, prophesee
from dse.recordings.formats.words import read_words
from dse.records import Block
from dse.registry import register

_VERSION = "2.0"


@register("recordings.formats", "evt2")
@dataclass(frozen=True)
class Evt2:
    """Prophesee EVT 2.0 (.raw); trigger and vendor-specific words are skipped."""

    suffixes: ClassVar[tuple[str, ...]] = (".raw",)

    def matches(self, path: Path, head: bytes) -> bool:
        """Return whether the header states EVT 2.0."""
        return prophesee.parse(head).evt == _VERSION

    def frame(self, path: Path) -> tuple[int, int] | None:
        """Return the width and height that the header states, if it does."""
        return prophesee.read_header(path).frame

    def blocks(self, path: Path, broken: Broken) -> Iterator[Block]:
        """Yield the events; before the first time high they have no time, which is a fault.

        Raises:
            RecordingError: as `Format.blocks`, or the header states another encoding.
        """
        from dse.recordings.formats.kernels import evt

        start = prophesee.read_evt_header(path, _VERSION, broken).end
        carried = np.array(evt.NOTHING_STATED)
        for read in read_words(path, start, 4, broken):
            words = np.frombuffer(read, dtype="<u4")
            t_us = np.empty(words.size, dtype=np.int64)
            x, y = np.empty((2, words.size), dtype=np.int32)
            polarity = np.empty(words.size, dtype=np.uint8)
            n, early, unknown, first_unknown = evt.decode_evt2(words, carried, t_us, x, y, polarity)
            prophesee.report_early(early, "time high", start, broken)
            if unknown:
                kind = int(words[first_unknown]) >> 28
                prophesee.report_unknown(unknown, _VERSION, kind, start + 4 * first_unknown, broken)
            start += len(read)
            if n:
                yield Block(t_us[:n], x[:n], y[:n], polarity[:n])
