"""Prophesee EVT 3.0: 16-bit words that say only what changed: time, row, one column or up to 12 at once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from dse.recordings.formats import BLOCK_EVENTS, Broken, prophesee
from dse.recordings.formats.words import read_words
from dse.records import Block
from dse.registry import register

_VERSION = "3.0"


@register("recordings.formats", "evt3")
@dataclass(frozen=True)
class Evt3:
    """Prophesee EVT 3.0 (.raw); trigger, continuation and vendor-specific words are skipped."""

    suffixes: ClassVar[tuple[str, ...]] = (".raw",)

    def matches(self, path: Path, head: bytes) -> bool:
        """Return whether the header states EVT 3.0."""
        return prophesee.parse(head).evt == _VERSION

    def frame(self, path: Path) -> tuple[int, int] | None:
        """Return the width and height that the header states, if it does."""
        return prophesee.read_header(path).frame

    def blocks(self, path: Path, broken: Broken) -> Iterator[Block]:
        """Yield the events; one whose time high, row or vector base was not stated before is a fault.

        Raises:
            RecordingError: as `Format.blocks`, or the header states another encoding.
        """
        from dse.recordings.formats.kernels import evt

        start = prophesee.read_evt_header(path, _VERSION, broken).end
        carried = np.array(evt.NOTHING_STATED)
        for read in read_words(path, start, 2, broken):
            words = np.frombuffer(read, dtype="<u2")
            k = 0
            while k < words.size:
                t_us = np.empty(BLOCK_EVENTS, dtype=np.int64)
                x, y = np.empty((2, BLOCK_EVENTS), dtype=np.int32)
                polarity = np.empty(BLOCK_EVENTS, dtype=np.uint8)
                k, n, early, unknown, first_unknown = evt.decode_evt3(words, k, carried, t_us, x, y, polarity)
                prophesee.report_early(early, "time high, row or vector base", start, broken)
                if unknown:
                    kind = int(words[first_unknown]) >> 12
                    prophesee.report_unknown(unknown, _VERSION, kind, start + 2 * first_unknown, broken)
                if n:
                    yield Block(t_us[:n], x[:n], y[:n], polarity[:n])
            start += len(read)
