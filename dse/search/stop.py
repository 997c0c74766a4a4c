"""When a search ends before all designs are trained: limits of time, and of what further designs bring."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dse.config.search import Stop
from dse.records import Floats

_HOUR_S = 3600.0
_REFERENCE = 1.05


@dataclass(frozen=True)
class Spent:
    """What a search has spent, and what it has reached.

    cpu_hours: of all trainings. wall_hours: of all sessions.
    session_s: seconds since `dse run` began.
    ages_s: (n,) seconds since the result of each design, in their order.
    costs: (n, objective) objectives of each, all minimised, the first one first.
    """

    cpu_hours: float
    wall_hours: float
    session_s: float
    ages_s: Sequence[float]
    costs: Sequence[Sequence[float]]


def reached(stop: Stop, spent: Spent) -> str:
    """Return the first condition that is reached, as a sentence; '' if none is."""
    if stop.cpu_hours is not None and spent.cpu_hours >= stop.cpu_hours:
        return f"search.stop.cpu_hours {stop.cpu_hours:g} is reached: {spent.cpu_hours:.3g} are spent"
    if stop.wall_hours is not None and spent.wall_hours >= stop.wall_hours:
        return f"search.stop.wall_hours {stop.wall_hours:g} is reached: {spent.wall_hours:.3g} are spent"
    if stop.pick_unchanged_for is not None:
        n = unchanged_for(spent.costs)
        if n >= stop.pick_unchanged_for:
            least = stop.pick_unchanged_for
            return f"search.stop.pick_unchanged_for {least} is reached: the best design is {n} trials old"
    if stop.front_gain_per_hour is not None and spent.session_s >= _HOUR_S:
        gain = gained(np.array(spent.costs, np.float64), np.array(spent.ages_s) >= _HOUR_S)
        if gain is not None and gain < stop.front_gain_per_hour:
            least_gain = stop.front_gain_per_hour
            return f"search.stop.front_gain_per_hour {least_gain:g} is reached: the front gained {gain:.3g} %"
    return ""


def unchanged_for(costs: Sequence[Sequence[float]]) -> int:
    """Return how many designs have ended since the best in the first objective, ties by the others."""
    if not costs:
        return 0
    best = min(range(len(costs)), key=lambda place: (tuple(costs[place]), place))
    return len(costs) - 1 - best


def gained(costs: Floats, before: np.ndarray) -> float | None:
    """Return by how many percent the front's hypervolume has grown; None if there was none before.

    Objectives are normalised over the range of all designs; the reference point lies 5 % beyond the worst.

    Args:
        costs: (n, objective), all minimised.
        before: (n,) which designs had ended before.
    """
    import moocore

    if not before.any():
        return None
    low, high = costs.min(axis=0), costs.max(axis=0)
    scaled = (costs - low) / np.where(high > low, high - low, 1.0)
    reference = [_REFERENCE] * costs.shape[1]
    first, last = (float(moocore.hypervolume(x, ref=reference)) for x in (scaled[before], scaled))
    return 100.0 * (last / first - 1.0)
