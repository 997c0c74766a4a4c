"""What the tests of the formats share: a file read whole, its faults, and memory."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from dse.recordings import RecordingError
from dse.recordings.formats import Format, Repairs, named
from dse.records import Block


def read(form: Format, path: Path, repair: bool = False) -> tuple[Block, list[str]]:
    """Return all events of a file, unchecked, and what was repaired."""
    repairs = Repairs(path.name, repair)
    blocks = list(form.blocks(path, repairs))
    types = {"t_us": np.int64, "x": np.int32, "y": np.int32, "polarity": np.uint8}
    for block in blocks:
        assert len(block.t_us) > 0
        assert {name: getattr(block, name).dtype for name in types} == types
    columns = {
        name: np.concatenate([np.empty(0, kind), *(getattr(block, name) for block in blocks)])
        for name, kind in types.items()
    }
    return Block(**columns), repairs.notes


def faulty(name: str, path: Path, content: bytes, n_left: int, *sentences: str) -> Block:
    """Check that a file is refused with a fault that repair notes, and return the events that repair leaves.

    Args:
        name: of the format.
        path: file to write.
        content: of the file.
        n_left: number of these events.
        sentences: parts of the fault and of the repair.
    """
    path.write_bytes(content)
    with pytest.raises(RecordingError) as error:
        read(named(name), path)
    found, notes = read(named(name), path, repair=True)
    assert len(notes) == 1 and len(found.t_us) == n_left
    for text in (str(error.value), notes[0]):
        assert text.startswith(f"{path.name}: ") and "; --repair " in text and "\n" not in text
    assert all(sentence in notes[0] for sentence in sentences), notes[0]
    return found


def refused(name: str, path: Path, content: bytes, sentence: str) -> None:
    """Check that a file is refused even with repair."""
    path.write_bytes(content)
    for repair in (False, True):
        with pytest.raises(RecordingError) as error:
            read(named(name), path, repair)
        assert str(error.value).startswith(f"{path.name}: ") and sentence in str(error.value)


def tuples(found: Block) -> list[tuple[int, int, int, int]]:
    """Return events as t_us, x, y and polarity."""
    columns = (found.t_us, found.x, found.y, found.polarity)
    return list(zip(*(column.tolist() for column in columns), strict=True))


def many(n: int, width: int, height: int) -> Block:
    """Return n events that differ from each other."""
    i = np.arange(n)
    return Block(
        3 * i, (i % width).astype(np.int32), (i // 7 % height).astype(np.int32), (i % 2).astype(np.uint8)
    )


def peak_bytes(form: Format, path: Path) -> tuple[int, int]:
    """Return how many events a file has, and the most memory that reading it took."""
    for _ in form.blocks(path, Repairs(path.name, False)):
        break  # imports what is needed
    tracemalloc.start()
    try:
        n = sum(len(block.t_us) for block in form.blocks(path, Repairs(path.name, False)))
        return n, tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
