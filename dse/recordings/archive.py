"""Writing event recordings, one after the other, to an .npz file that component `events` reads back."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dse.recordings import RecordingError
from dse.records import Array, Block
from dse.store import atomic


@contextlib.contextmanager
def event_archive(
    path: Path, width: int, height: int, duration_us: int, columns: Mapping[str, Array]
) -> Iterator[Callable[[Block], None]]:
    """Yield a function that takes the next recording; the file appears when the block succeeds, whole.

    Memory holds the events, each value in the smallest unsigned type that holds its range.

    Args:
        path: the .npz file, replaced if it exists; its folder must exist.
        width: addresses x are below.
        height: addresses y are below.
        duration_us: no event is later.
        columns: label columns, each (n,): one value for each recording that will be given.

    Raises:
        RecordingError: the disk refuses (full, read-only, ...), or another number of recordings was given.
    """
    ranges = {"t_us": duration_us, "x": width - 1, "y": height - 1, "polarity": 1}
    parts = {name: [np.zeros(0, np.min_scalar_type(most))] for name, most in ranges.items()}
    offsets = [0]

    def append(block: Block) -> None:
        for name, gathered in parts.items():
            gathered.append(getattr(block, name).astype(gathered[0].dtype))
        offsets.append(offsets[-1] + len(block.t_us))

    yield append
    for column, values in columns.items():
        if len(values) != len(offsets) - 1:
            raise RecordingError(
                f"{path}: column '{column}' must have one value for each of the {len(offsets) - 1} "
                f"recordings, got {len(values)}"
            )
    events = {name: np.concatenate(parts.pop(name)) for name in ranges}
    try:
        with atomic(path) as temporary, temporary.open("wb") as file:
            arrays: dict[str, Any] = {**events, "offsets": offsets, "width": width, "height": height}
            np.savez(file, **(arrays | dict(columns)))
    except OSError as error:
        why = os.strerror(error.errno) if error.errno else str(error)
        raise RecordingError(f"{path}: cannot be written: {why}; no partial file remains") from error
