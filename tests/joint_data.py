"""A small joint target: three textures in two profiles, one of the six never recorded."""

import numpy as np

from dse.base.records import Dataset, Head, Spikes
from tests.saved_data import in_a_row

PAIRS = ((0, 0), (0, 1), (1, 0), (1, 1), (2, 0))


def joint(n_steps=40, n=80, margin=0):
    """Return textures told apart by which third of 12 channels fires more, profiles by even or odd ones."""
    rng = np.random.default_rng(12)
    target = np.arange(n) % len(PAIRS)
    texture, profile = (np.array([pair[k] for pair in PAIRS]) for k in range(2))
    share = np.full((n, n_steps + 2 * margin, 12), 0.05)
    for i, k in enumerate(target):
        share[i, :, 4 * texture[k] : 4 * texture[k] + 4] += 0.3
        share[i, :, profile[k] :: 2] += 0.15
    x = rng.random(share.shape) < share
    flat = x.reshape(-1, 12)
    offsets = np.concatenate([[0], np.cumsum(flat.sum(axis=1))]).astype(np.int64)
    start = np.full(n, margin, np.int32)
    order = rng.permutation(n)
    return Dataset(
        spikes=Spikes(offsets, np.nonzero(flat)[1].astype(np.int32), n_steps + 2 * margin, 12, 5.0),
        target=target.astype(np.int64),
        classes=tuple(f"{'abc'[a]}|{'pq'[b]}" for a, b in PAIRS),
        start=start,
        start_low=start - margin,
        start_high=start + margin,
        n_steps=n_steps,
        train=np.sort(order[: n // 2]),
        validation=np.sort(order[n // 2 : -10]),
        test=np.sort(order[-10:]),
        positions=in_a_row(12),
        heads=(Head("texture", ("a", "b", "c"), texture), Head("profile", ("p", "q"), profile)),
    )
