"""Prototypes of time surfaces, learnt from the events of training recordings: by k-means, or online."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from dse.base.records import Array
from dse_papers.models.time_surfaces import Field, Memory, Stream, prepared

# Numbers of all surfaces that are clustered together: 32 MiB of float32, seconds of k-means.
_MOST_NUMBERS = 2**23
# Sweeps of k-means; the last ones move the means by next to nothing.
_MOST_SWEEPS = 100


def drawn_surfaces(
    recordings: Sequence[Callable[[], Stream]],
    n_events: Sequence[int],
    field: Field,
    n: int,
    least: int,
    rng: np.random.Generator,
) -> Array:
    """Return the surfaces of n events drawn from all events without replacement, (<= n, size) float32.

    Fewer are drawn where there are fewer events, or where n would hold more than 2^23 numbers.

    Args:
        recordings: each gives its events.
        n_events: (recording,) how many that are.
        field: of the layer.
        n: number of surfaces.
        least: how many are drawn however many numbers they hold.
        rng: draws the events.
    """
    ends = np.cumsum(n_events, dtype=np.int64)
    total = int(ends[-1])
    n = min(total, max(least, min(n, _MOST_NUMBERS // field.size)))
    chosen = np.sort(rng.choice(total, n, replace=False))
    surfaces = np.zeros((n, field.size), dtype=np.float32)
    memory = Memory(field)
    for i, recording in enumerate(recordings):
        first, end = np.searchsorted(chosen, [ends[i] - n_events[i], ends[i]])
        if first < end:
            memory.forget()
            surfaces[first:end] = memory.surfaces(recording(), chosen[first:end] - (ends[i] - n_events[i]))
    return surfaces


def clustered(surfaces: Array, n: int, rng: np.random.Generator) -> Array:
    """Return the means that Lloyd's algorithm finds from a start of k-means++, (<= n, size) float64.

    Where no more than n surfaces differ, they are the prototypes; without a surface one of zeros is.
    """
    from sklearn.cluster import KMeans
    from threadpoolctl import threadpool_limits

    differing = _differing(surfaces, n + 1)
    if len(differing) <= n:
        return _at_least_one(differing)
    lloyd = KMeans(n, n_init=1, max_iter=_MOST_SWEEPS, random_state=int(rng.integers(2**31)))
    with threadpool_limits(limits=1):  # threads add up in the order in which they finish
        lloyd.fit(surfaces)
    return np.asarray(lloyd.cluster_centers_, dtype=np.float64)


def learnt_online(
    recordings: Sequence[Callable[[], Stream]],
    surfaces: Array,
    field: Field,
    n: int,
    rng: np.random.Generator,
) -> Array:
    """Return prototypes after one pass over all events (`time_surfaces.learnt_online`), (<= n, size) float64.

    They start as surfaces drawn at random, where the source takes those of the first events: the first events
    of one recording are alike. Recordings come in random order. Where no more than n surfaces differ, fewer
    prototypes learn; without a surface there is one of zeros.

    Source: Lagorce et al. 2017, Algorithm 1.
    """
    start = _at_least_one(_differing(surfaces[rng.permutation(len(surfaces))], n))
    prototypes, chosen = prepared(start), np.ones(len(start))
    memory = Memory(field)
    for i in rng.permutation(len(recordings)):
        memory.forget()
        memory.learn(recordings[i](), prototypes, chosen)
    return np.ascontiguousarray(prototypes.columns.T)


def _differing(surfaces: Array, most: int) -> Array:
    """Return the first surfaces that differ from all before them, `most` of them at most."""
    first: dict[bytes, int] = {}
    for i, s in enumerate(surfaces):
        first.setdefault(s.tobytes(), i)
        if len(first) == most:
            break
    return surfaces[list(first.values())]


def _at_least_one(surfaces: Array) -> Array:
    return np.asarray(surfaces if len(surfaces) else np.zeros((1, surfaces.shape[1])), dtype=np.float64)
