"""Racing: which designs go on from a rung, by successive halving over fronts.

Designs are ranked by fronts: those that no other dominates, then those that only these dominate, and so on.
The best ones go on, front by front. Of the front that is cut, the designs go on whose hypervolume is the
largest, chosen one after the other, each for what it adds to those before it; objectives are scaled to the
range of that front, and the reference lies 1 % beyond its worst.

Source: Jamieson and Talwalkar 2016 (successive halving); Deb et al. 2002 (sorting by fronts).
"""

from __future__ import annotations

import heapq

import numpy as np

from dse.base.records import Floats, Ints

_REFERENCE = 1.01


def best(costs: Floats, n: int) -> Ints:
    """Return the places of the n best designs, rising; all if there are no more.

    Args:
        costs: (design, objective), finite, all minimised.
        n: how many.
    """
    import moocore

    if costs.shape[1] == 1:
        return np.sort(np.argsort(costs[:, 0], kind="stable")[:n])
    rank = moocore.pareto_rank(costs) if len(costs) else np.zeros(0, np.int64)
    places: list[int] = []
    for front in np.unique(rank):
        members = np.flatnonzero(rank == front)
        left = n - len(places)
        if len(members) > left:
            places += members[_widest(costs[members], left)].tolist()
            break
        places += members.tolist()
    return np.array(sorted(places), np.int64)


def _widest(costs: Floats, n: int) -> list[int]:
    """Return the places of n members of a front with a large hypervolume, the first one first.

    What a member adds falls with every member that is chosen before it, so only those are computed again
    whose last number is the largest.
    """
    import moocore

    span = np.ptp(costs, axis=0)
    scaled = (costs - costs.min(axis=0)) / np.where(span > 0, span, 1.0)
    reference = np.full(costs.shape[1], _REFERENCE)
    chosen: list[int] = []
    volume = 0.0
    waiting = [(-float(np.prod(reference - row)), place, 0) for place, row in enumerate(scaled)]
    heapq.heapify(waiting)
    while waiting and len(chosen) < n:
        gain, place, when = heapq.heappop(waiting)
        if when == len(chosen):
            chosen.append(place)
            volume -= gain
        else:
            whole = float(moocore.hypervolume(scaled[[*chosen, place]], ref=reference))
            heapq.heappush(waiting, (volume - whole, place, len(chosen)))
    return chosen
