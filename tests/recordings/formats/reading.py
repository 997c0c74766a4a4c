"""What the tests of the formats share: a file read whole, events drawn at random, and the memory it takes."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
from hypothesis import strategies as st

from dse.recordings.formats import Format, Repairs
from dse.records import Array, Block


def read(form: Format, path: Path, repair: bool = False) -> tuple[Block, list[str]]:
    """Return all events of a file, unchecked, and what was repaired."""
    repairs = Repairs(path.name, repair)
    blocks = list(form.blocks(path, repairs.broken))
    types = {"t_us": np.int64, "x": np.int32, "y": np.int32, "polarity": np.uint8}
    for block in blocks:
        assert len(block.t_us) > 0
        assert {name: getattr(block, name).dtype for name in types} == types
    columns = {
        name: np.concatenate([np.empty(0, kind), *(getattr(block, name) for block in blocks)])
        for name, kind in types.items()
    }
    return Block(**columns), repairs.notes


def same(found: Block, t_us: Array, x: Array, y: Array, polarity: Array) -> bool:
    """Return whether these are the events."""
    pairs = ((found.t_us, t_us), (found.x, x), (found.y, y), (found.polarity, polarity))
    return all(np.array_equal(a, b) for a, b in pairs)


@st.composite
def events(draw: st.DrawFn, width: int, height: int, longest_us: int = 1000) -> Block:
    """Draw up to 60 events, the times from 0 with steps of up to `longest_us`."""
    rows = draw(
        st.lists(
            st.tuples(
                st.integers(0, longest_us),
                st.integers(0, width - 1),
                st.integers(0, height - 1),
                st.integers(0, 1),
            ),
            max_size=60,
        )
    )
    steps, x, y, polarity = np.array(rows, np.int64).reshape(-1, 4).T
    return Block(np.cumsum(steps), x.astype(np.int32), y.astype(np.int32), polarity.astype(np.uint8))


def many(n: int, width: int, height: int) -> Block:
    """Return n events that differ from each other."""
    i = np.arange(n)
    return Block(
        3 * i, (i % width).astype(np.int32), (i // 7 % height).astype(np.int32), (i % 2).astype(np.uint8)
    )


def peak_bytes(form: Format, path: Path) -> tuple[int, int]:
    """Return how many events a file has, and the most memory that reading it took."""
    for _ in form.blocks(path, Repairs(path.name, False).broken):
        break  # imports and compiles what is needed
    tracemalloc.start()
    try:
        n = sum(len(block.t_us) for block in form.blocks(path, Repairs(path.name, False).broken))
        return n, tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
