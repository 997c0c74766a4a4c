"""Random numbers by counter (splitmix64): number n of a key, whatever was drawn before it."""

from __future__ import annotations

import numpy as np

from dse.base.native.compiled import compiled


@compiled(_nrt=False)
def splitmix(key, counter):  # type: ignore[no-untyped-def]
    """Return the 64 random bits of a key and a counter."""
    z = np.uint64(key) + np.uint64(counter + 1) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@compiled(_nrt=False)
def unit(z):  # type: ignore[no-untyped-def]
    """Return 64 random bits as a number in (0, 1)."""
    return (np.int64(z >> np.uint64(12)) + 0.5) * 2.0**-52
