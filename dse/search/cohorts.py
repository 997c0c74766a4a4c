"""Which runs train together, and in which order: a plan that changes how long a study takes, nothing else.

Runs share a worker's passes over the events where their keys are equal. The plan makes as few cohorts as
three rules allow:

1. Memory: the runs' own bytes and the widest of their shared ones never exceed a worker's budget.
2. Loss: a cohort of several costs no more than a stated time, for that is what a killed worker loses.
3. Balance: by the estimates, the last worker ends at most 2 % later than it would with every run alone.
   In both cases the most expensive work goes first, to whoever is free (Graham 1969, REFERENCES.md).
"""

from __future__ import annotations

import heapq
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass

_TOLERANCE = 1.02


@dataclass(frozen=True)
class Demand:
    """What one run asks of a worker.

    key: runs of equal keys may train together.
    memory_bytes: what it holds beside the others of its cohort.
    workspace_bytes: what it shares with them; the widest of a cohort counts.
    cost: estimated seconds of training.
    """

    key: Hashable
    memory_bytes: int
    workspace_bytes: int
    cost: float

    @property
    def alone_bytes(self) -> int:
        """What a worker needs to train it alone."""
        return self.memory_bytes + self.workspace_bytes


@dataclass
class _Bin:
    """A cohort that is being filled."""

    members: list[int]
    memory_bytes: int = 0
    workspace_bytes: int = 0
    cost: float = 0.0

    def takes(self, one: Demand, budget_bytes: int, longest: float) -> bool:
        needed = self.memory_bytes + one.memory_bytes + max(self.workspace_bytes, one.workspace_bytes)
        return not self.members or (needed <= budget_bytes and self.cost + one.cost <= longest)

    def add(self, number: int, one: Demand) -> None:
        self.members.append(number)
        self.memory_bytes += one.memory_bytes
        self.workspace_bytes = max(self.workspace_bytes, one.workspace_bytes)
        self.cost += one.cost


def plan(
    demands: Sequence[Demand], budget_bytes: int, n_workers: int, longest: float
) -> list[tuple[int, ...]]:
    """Return cohorts as places in `demands`, the most expensive cohort first.

    Args:
        demands: one per run.
        budget_bytes: memory of a worker.
        n_workers: workers that take one cohort after another.
        longest: seconds that a cohort of several may cost.

    Raises:
        ValueError: a run exceeds the budget alone.
    """
    assert all(one.cost >= 0 for one in demands), "no number of cohorts would be balanced"
    for number, one in enumerate(demands):
        if one.alone_bytes > budget_bytes:
            raise ValueError(f"run {number} needs {one.alone_bytes} bytes, but a worker has {budget_bytes}")
    groups: dict[Hashable, list[int]] = {}
    for number in sorted(range(len(demands)), key=lambda i: (-demands[i].cost, i)):
        groups.setdefault(demands[number].key, []).append(number)
    packed = {key: _pack(members, demands, budget_bytes, longest, 1) for key, members in groups.items()}
    enough = _TOLERANCE * makespan([one.cost for one in demands], n_workers)
    while makespan([one.cost for bins in packed.values() for one in bins], n_workers) > enough:
        key = _most_expensive_of_several(packed)
        packed[key] = _pack(groups[key], demands, budget_bytes, longest, len(packed[key]) + 1)
    bins = [one for bins in packed.values() for one in bins]
    bins.sort(key=lambda one: (-one.cost, min(one.members)))
    return [tuple(sorted(one.members)) for one in bins]


def makespan(costs: Iterable[float], n_workers: int) -> float:
    """Return when the last worker ends, if the next free worker takes the most expensive work left."""
    ends = [0.0] * n_workers
    for cost in sorted(costs, reverse=True):
        heapq.heapreplace(ends, ends[0] + cost)
    return max(ends)


def _pack(
    members: Sequence[int], demands: Sequence[Demand], budget_bytes: int, longest: float, n: int
) -> list[_Bin]:
    """Spread runs of one key evenly over n cohorts, or over as many more as memory and loss ask for.

    Args:
        members: places in `demands`, the most expensive first.
        demands: one per run.
        budget_bytes: memory of a cohort.
        longest: seconds that a cohort of several may cost.
        n: cohorts to begin with, at most one per run.
    """
    while True:
        bins = [_Bin([]) for _ in range(n)]
        for number in members:
            one = demands[number]
            open_bins = [x for x in bins if x.takes(one, budget_bytes, longest)]
            if not open_bins:
                open_bins = [_Bin([])]
                bins += open_bins
            min(open_bins, key=lambda x: (x.cost, len(x.members))).add(number, one)
        if len(bins) == n:
            return bins
        n = len(bins)  # what was left over must not stay a cohort of its own: begin again with as many


def _most_expensive_of_several(packed: Mapping[Hashable, Sequence[_Bin]]) -> Hashable:
    """Return the key of the most expensive cohort that can be split."""
    costs = {
        key: max((one.cost for one in bins if len(one.members) > 1), default=-1.0)
        for key, bins in packed.items()
    }
    return max(costs, key=lambda key: costs[key])
