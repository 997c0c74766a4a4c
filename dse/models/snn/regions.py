"""Regions of a sensor: channels whose synapses onto a neuron share one weight (`model.regions`).

Places are divided by the angle around their centre into sectors, and each sector by the distance from it
into three rings: the innermost sixteenth of its places, those up to a quarter, and the rest. On a square
array these are rings at about a quarter and a half of the way to the edge. Sectors, and the same rings of all
sectors, hold equal numbers of places, so that no region is empty. Places on a line are divided into equal
runs.

Planes (polarities, thresholds) and delayed copies of the channels have weights of their own.
"""

from __future__ import annotations

import numpy as np

from dse.base.records import Ints

RINGS = 3
_ENDS = np.array([1 / 16, 1 / 4])
"""Share of a sector's places up to which each ring but the last reaches."""


def regions_of(positions: Ints, n_regions: int) -> Ints:
    """Return the number of every channel's region, (n_channels,): planes in turn, without gaps.

    Args:
        positions: (n_channels, 3) x, y and plane.
        n_regions: of each plane, a multiple of `RINGS`.
    """
    places, place = np.unique(positions[:, :2], axis=0, return_inverse=True)
    if len(places) < n_regions:
        raise ValueError(
            f"model.regions must be at most the {len(places)} places of the channels, got {n_regions}"
        )
    plane = np.unique(positions[:, 2], return_inverse=True)[1]
    number = plane.ravel() * n_regions + _divided(places, n_regions)[place.ravel()]
    return np.asarray(np.unique(number, return_inverse=True)[1].ravel())


def _divided(places: Ints, n_regions: int) -> Ints:
    """Return the region of every place, (place,), from x and y, (place, 2)."""
    if (np.ptp(places, axis=0) == 0).any():
        return np.arange(len(places)) * n_regions // len(places)  # np.unique has sorted them
    x, y = (2 * places.astype(np.int64) - places.min(axis=0) - places.max(axis=0)).T
    angle, distance = np.arctan2(y, x) % (2 * np.pi), x * x + y * y
    n_sectors = n_regions // RINGS
    region = np.empty(len(places), np.int64)
    for sector, members in enumerate(np.array_split(np.lexsort((distance, angle)), n_sectors)):
        outwards = members[np.lexsort((angle[members], distance[members]))]
        first, second = np.rint(_ENDS * len(members)).astype(int)
        first = max(1, first)
        ring = np.searchsorted([first, max(first + 1, second)], np.arange(len(members)), side="right")
        region[outwards] = sector * RINGS + ring
    return region
