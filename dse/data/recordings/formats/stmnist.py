"""ST-MNIST recordings: the matrix `spiketrain` of a MATLAB file, a column per event.

    spiketrain (101, n): rows 0-99 the taxels, -1 (OFF), 0 or 1 (ON); row 100 the time in seconds

Taxel k is column k mod 10 of row k div 10. Every non-zero entry is an event at its column's time, rounded to
the microsecond.

Source: See et al., ST-MNIST, arXiv:2005.04319.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from dse.base.records import Block
from dse.base.registry import register
from dse.data.recordings import RecordingError, arrays
from dse.data.recordings.formats import Format, Repairs, block_of, open_file

VARIABLE = "spiketrain"
SIDE = 10
N_ROWS = SIDE * SIDE + 1

_HEADER_BYTES = 128
_LATEST_S = 1e12


@register("recordings.formats", "stmnist")
@dataclass(frozen=True)
class Stmnist(Format):
    """ST-MNIST: `spiketrain` of a MATLAB .mat file, 10 x 10 taxels."""

    suffixes: ClassVar[tuple[str, ...]] = (".mat",)
    marks: ClassVar[tuple[bytes, ...]] = (b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file")

    def frame(self, path: Path) -> tuple[int, int]:
        """Return the taxels along x and y, of a file that holds a header."""
        with open_file(path) as file:
            if len(file.read(_HEADER_BYTES)) < _HEADER_BYTES:
                raise RecordingError(f"{path.name}: must be a MATLAB v5 file, got a truncated header")
            return SIDE, SIDE

    def blocks(self, path: Path, broken: Repairs) -> Iterator[Block]:
        """Yield the events; columns that have no time are a fault."""
        with open_file(path):
            matrix = arrays.load(path, [VARIABLE])[VARIABLE]
        matrix = matrix[:, None] if matrix.ndim == 1 and len(matrix) == N_ROWS else matrix
        if matrix.ndim != 2 or len(matrix) != N_ROWS or matrix.dtype.kind not in "biuf":
            got = f"{matrix.dtype} of shape {matrix.shape}"
            raise RecordingError(f"{path.name}: {VARIABLE} must be {N_ROWS} x n real numbers, got {got}")
        time_s, values = matrix[-1].astype(np.float64), matrix[:-1].T
        sound = (np.abs(time_s) < _LATEST_S) & np.isfinite(values).all(axis=1)
        broken.where(
            ~sound, "column {} must hold numbers and a time in seconds, got the time {}",
            "drops columns without a time or with values that are not numbers",
            np.arange(len(sound)), time_s,
        )  # fmt: skip
        column, taxel = np.nonzero(np.where(sound[:, None], values, 0))
        t_us = np.rint(time_s[column] * 1e6)
        yield from block_of(t_us, taxel % SIDE, taxel // SIDE, values[column, taxel] > 0)
