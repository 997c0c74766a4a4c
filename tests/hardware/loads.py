"""Work of an inference, from plain numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dse.records import Operations, Workload


def network(
    sizes: Any,
    spikes: ArrayLike,
    updates: ArrayLike | None = None,
    n_steps: ArrayLike = 100.0,
    step_ms: float = 1.0,
    recurrent: tuple[bool, ...] | None = None,
    **more: Any,
) -> Workload:
    """Return the work of a network, feed-forward unless stated; further fields of `Workload` as keywords."""
    return Workload(
        sizes=tuple(sizes),
        recurrent=recurrent or (False,) * (len(sizes) - 1),
        n_steps=np.asarray(n_steps, dtype=float),
        spikes=np.asarray(spikes, dtype=float),
        updates=None if updates is None else np.asarray(updates, dtype=float),
        step_ms=step_ms,
        **more,
    )


def silent(sizes: Any, **more: Any) -> Workload:
    """Return the work of a network in which nothing fires."""
    return network(sizes, np.zeros(len(sizes)), **more)


def operations(
    macs: ArrayLike,
    additions: ArrayLike = 0.0,
    updates: ArrayLike = 0.0,
    n_weights: ArrayLike = 0.0,
    duration_ms: ArrayLike = 0.0,
    number_bits: int = 8,
) -> Operations:
    """Return the work of any other classifier."""
    counts = (np.asarray(x, dtype=float) for x in (macs, additions, updates, n_weights, duration_ms))
    return Operations(*counts, number_bits)
