"""Writing event recordings, one after the other, to an .npz file that component `events` reads back.

An array of an .npz file needs its length before its values. So values are first gathered in files without a
name, which the system removes with the process however it ends; memory holds one recording at a time.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
import zipfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import IO

import numpy as np
from numpy.lib import format as npy

from dse.recordings import RecordingError
from dse.records import Array, Block
from dse.store import atomic

ADDRESSES = ("t_us", "x", "y", "polarity")
"""Arrays with one value per event, each in the smallest unsigned type that holds its range."""


@contextlib.contextmanager
def event_archive(
    path: Path, width: int, height: int, duration_us: int, columns: Mapping[str, Array]
) -> Iterator[Callable[[Block], None]]:
    """Yield a function that takes the next recording; the file appears when the block succeeds, whole.

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
    types = {name: np.min_scalar_type(ranges[name]) for name in ADDRESSES}
    offsets = [0]
    with contextlib.ExitStack() as stack:
        with _explained(path):
            # Unbuffered: a full disk is met while writing and not again while closing.
            gathered = {
                name: stack.enter_context(tempfile.TemporaryFile(dir=path.parent, buffering=0))
                for name in ADDRESSES
            }

        def append(block: Block) -> None:
            with _explained(path):
                for name, file in gathered.items():
                    _write(file, np.ascontiguousarray(getattr(block, name), dtype=types[name]))
            offsets.append(offsets[-1] + len(block.t_us))

        yield append
        for column, values in columns.items():
            if len(values) != len(offsets) - 1:
                raise RecordingError(
                    f"{path}: column '{column}' must have one value for each of the {len(offsets) - 1} "
                    f"recordings, got {len(values)}"
                )
        small = {
            "offsets": np.array(offsets),
            "width": np.array(width),
            "height": np.array(height),
            **columns,
        }
        with _explained(path), atomic(path) as temporary:
            _assemble(temporary, gathered, types, offsets[-1], small)


def _assemble(
    path: Path,
    gathered: Mapping[str, IO[bytes]],
    types: Mapping[str, np.dtype],
    n_events: int,
    small: Mapping[str, Array],
) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        for name, file in gathered.items():
            header = {"descr": types[name].str, "fortran_order": False, "shape": (n_events,)}
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                npy.write_array_header_1_0(member, header)
                file.seek(0)
                shutil.copyfileobj(file, member, 1 << 20)
            file.close()  # its space is free before the next array is copied
        for name, values in small.items():
            with archive.open(f"{name}.npy", "w") as member:
                npy.write_array(member, values, allow_pickle=False)


def _write(file: IO[bytes], values: Array) -> None:
    left = values.data.cast("B") if len(values) else memoryview(b"")
    while left:
        left = left[file.write(left) :]


@contextlib.contextmanager
def _explained(path: Path) -> Iterator[None]:
    """Turn what the disk refuses into one sentence about `path`."""
    try:
        yield
    except OSError as error:
        why = os.strerror(error.errno) if error.errno else str(error)
        raise RecordingError(f"{path}: cannot be written: {why}; no partial file remains") from error
