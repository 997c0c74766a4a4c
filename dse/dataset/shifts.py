"""Windows at other positions of the same recordings."""

from __future__ import annotations

import dataclasses

import numpy as np

from dse.records import Bools, Dataset


def has_room(dataset: Dataset, steps: int) -> Bools:
    """Return (n,) bool: whether the window of a sample, moved by some steps, lies where training windows may.

    Args:
        dataset: samples without spikes have no room, except for 0.
        steps: > 0 later, < 0 earlier.
    """
    start = dataset.start.astype(np.int64) + steps
    return np.asarray((dataset.start_low <= start) & (start <= dataset.start_high))


def shifted(dataset: Dataset, steps: int) -> Dataset:
    """Return the data set with every evaluated window moved by some steps, as far as it has room."""
    start = np.clip(dataset.start + steps, dataset.start_low, dataset.start_high)
    return dataclasses.replace(dataset, start=start.astype(np.int32))
