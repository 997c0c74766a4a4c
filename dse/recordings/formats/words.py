"""What formats with events of one size share: whole words in blocks, and times of a counter that wraps."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from dse.recordings.formats import BLOCK_EVENTS, Broken, open_file
from dse.records import Array, Ints


def read_words(path: Path, start: int, size: int, broken: Broken) -> Iterator[bytes]:
    """Yield the bytes from `start` on, whole words of `size` bytes, BLOCK_EVENTS words at a time.

    Raises:
        RecordingError: the file cannot be opened, or the last word is cut and `broken` raised it.
    """
    with open_file(path) as file:
        file.seek(start)
        while read := file.read(BLOCK_EVENTS * size):
            if cut := len(read) % size:
                broken(
                    f"the last word must have {size} bytes, got {cut} at byte {start + len(read) - cut}",
                    "drops a truncated last word",
                )
            start += len(read)
            if len(read) >= size:
                yield read[: len(read) - cut]


def unwrapped(t: Array, before: int, period: int) -> Ints:
    """Return the times of a counter that wraps at `period` as if it never did.

    A fall by more than 7/8 of the period is a wrap; a smaller one is a time that runs backwards, and stays.

    Args:
        t: (n,) int64 in [0, period).
        before: the last time returned for this file; 0 at its beginning.
        period: in the unit of t.
    """
    wraps = np.cumsum(np.diff(t, prepend=before % period) < -(period // 8 * 7))
    counted: Array = t + (wraps + before // period) * period
    return counted
