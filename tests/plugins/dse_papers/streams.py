"""Streams of events for tests: given one by one, or drawn."""

import numpy as np

from dse_papers.models.time_surfaces import Stream

WIDTH, HEIGHT, PLANES = 6, 5, 3


def stream(*events):
    """Return events given as (t_us, x, y, plane)."""
    t, x, y, plane = np.array(events, dtype=np.int64).reshape(-1, 4).T
    return Stream(t.copy(), x.astype(np.int32), y.astype(np.int32), plane.astype(np.int32))


def drawn(seed, n, width=WIDTH, height=HEIGHT, planes=PLANES):
    """Return events of which many come at the same time."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.choice([0, 0, 1, 700, 40_000], n))
    return stream(
        *zip(
            t.tolist(),
            rng.integers(0, width, n).tolist(),
            rng.integers(0, height, n).tolist(),
            rng.integers(0, planes, n).tolist(),
            strict=True,
        )
    )
