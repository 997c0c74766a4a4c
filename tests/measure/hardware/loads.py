"""Work of an inference, from plain numbers."""

import numpy as np

from dse.base.records import Operations, Workload


def network(sizes, spikes, updates=None, n_steps=100.0, step_ms=1.0, recurrent=None, **more):
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


def silent(sizes, **more):
    """Return the work of a network in which nothing fires."""
    return network(sizes, np.zeros(len(sizes)), **more)


def operations(macs, additions=0.0, updates=0.0, n_weights=0.0, duration_ms=0.0, number_bits=8):
    """Return the work of any other classifier, of as many design points as any count has."""
    counts = (np.asarray(x, dtype=float) for x in (macs, additions, updates, n_weights, duration_ms))
    return Operations(*np.broadcast_arrays(*counts), number_bits)


PLAIN = network((24, 50, 7), [46, 100, 10], [400, 70])
"""A network in which layers are updated seldom."""
