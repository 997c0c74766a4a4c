"""A batch as a cohort trains on it: its rows, and by input the rows in which that input fires."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dse.base.records import Array
from dse.engine import kernels
from dse.engine.events import Rows

DIFFERENTIATED_ROWS = 2**14
"""Most rows (sample and step) that automatic differentiation goes through at a time."""
_CHUNK_ROWS = 4096  # a block of 64 float32 columns is then 1 MiB, half of a second-level cache


@dataclass(frozen=True)
class Batch:
    """Rows, cut into chunks of whole samples.

    starts: (chunk + 1,) first sample of each chunk, and the end.
    offsets: (chunk, input + 1) int64 where an input's rows lie in `index`.
    index: (n_spikes,) int32 rows counted from the first of the chunk.
    times: as in `Rows`, in the order of `index`.
    """

    rows: Rows
    starts: Array
    offsets: Array
    index: Array
    times: Array


def chunk_samples(n_samples: int, n_steps: int) -> int:
    """Return how many samples a chunk has; it follows from the batch alone, so sums have a fixed order."""
    return max(1, min(n_samples, _CHUNK_ROWS // max(1, n_steps)))


def batch_of(rows: Rows) -> Batch:
    """Return rows with their transpose, chunk by chunk."""
    size = chunk_samples(rows.n_samples, rows.n_steps)
    starts = np.append(np.arange(0, rows.n_samples, size), rows.n_samples)
    offsets = np.empty((len(starts) - 1, rows.n_inputs + 1), np.int64)
    index, times = np.empty_like(rows.index), np.empty_like(rows.times)
    kernels.transpose(
        rows.offsets, rows.index, rows.times, rows.n_inputs, starts * rows.n_steps, offsets, index, times
    )
    return Batch(rows, starts, offsets, index, times)
