"""What a chip asks of one architecture, per count of what happens in an inference.

A kind of hardware compiles an architecture and its figures into a `Plan`; `dse.measure.hardware.cost`
multiplies it with the counts of any number of design points.
"""

from __future__ import annotations

import bisect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dse.base.records import Bools, Floats, Workload
from dse.measure.hardware.interval import Interval


class NotApplicable(ValueError):
    """A chip cannot run such a classifier; one sentence says why."""


@dataclass(frozen=True)
class Misfit:
    """A limit that is broken.

    rule: its name, as the profile or the kind of hardware calls it.
    text: what the classifier needs and what the chip has.
    change: the smallest change that would fit.
    """

    rule: str
    text: str
    change: str

    def __str__(self) -> str:
        return f"{self.text}; fits with {self.change}"


@dataclass(frozen=True)
class Placement:
    """Where a classifier goes on a chip; one that does not fit is placed as if the chip went on.

    cores: per layer after the input; of anything else, one entry.
    misfits: every limit that is broken (empty: it fits).
    low, high: fewest and most cores that practice may take, where that differs from arithmetic.
    assumptions: what the numbers rest on, a sentence each.
    """

    cores: tuple[int, ...]
    misfits: tuple[Misfit, ...] = ()
    low: int | None = None
    high: int | None = None
    assumptions: tuple[str, ...] = ()

    @property
    def n_cores(self) -> int:
        return sum(self.cores)

    @property
    def core_range(self) -> Interval[int]:
        """Cores in use, and what practice may take."""
        return Interval(self.n_cores, self.low or self.n_cores, self.high or self.n_cores)


@dataclass(frozen=True)
class Congestion:
    """Where many spikes go to many cores, queues make a step longer.

    layers: (layer,) bool, whether the spikes of a layer, input first, go to many cores.
    spikes: per step and layer, above which the network is congested.
    factor: (D...) times a step.
    """

    layers: Bools
    spikes: float
    factor: Floats


@dataclass(frozen=True)
class Plan:
    """Costs of an inference, linear in its F counts (`Workload.counts`, `Operations.counts`).

    D... are the draws of the figures.

    energy_pj: cause -> (D..., F), what happening costs.
    time_ns: (D..., K, F); the time of an inference, or of a step, is the largest of K.
    static_mw: (D...), power of the whole chip while it computes.
    idle_mw: (D...), power of the whole chip while it waits.
    placement: None where no chip is meant, so that there are no cores, times and limits either.
    share: of the chip's cores that are in use.
    running_mw: (D...), power while it computes, where that does not depend on the counts; None where it does.
    """

    energy_pj: Mapping[str, Floats]
    time_ns: Floats
    static_mw: Floats
    idle_mw: Floats
    placement: Placement | None
    congestion: Congestion | None = None
    share: float = 1.0
    running_mw: Floats | None = None


def largest(least: int, most: int, fits: Callable[[int], bool]) -> int:
    """Return the largest number that fits, of those from one that does; what is larger never fits better."""
    return least + bisect.bisect_left(range(least + 1, most + 1), x=True, key=lambda n: not fits(n))


def per_count(
    load: Workload, *, step: float = 0.0, spike: Sequence[float] = (), update: Sequence[float] = ()
) -> Floats:
    """Return a number for each count of a network (`Workload.counts`), (F,).

    Args:
        load: the network.
        step: number of a step.
        spike: number of a spike of each layer, input first; empty: 0.
        update: number of a neuron update of each layer after the input; empty: 0.
    """
    n_layers = len(load.sizes)
    return np.array([step, *(spike or [0.0] * n_layers), *(update or [0.0] * (n_layers - 1))], np.float64)


def of_cycles(cycles: Mapping[str, Floats], cycle_pj: Floats, clock_mhz: float, **beside: Any) -> Plan:
    """Return the plan of what takes (D..., F) cycles by cause, of (D...) pJ each; `beside`: its rest."""
    total: Floats = np.sum(list(cycles.values()), axis=0)
    energy_pj = {cause: cycle_pj[..., None] * of_cause for cause, of_cause in cycles.items()}
    return Plan(energy_pj=energy_pj, time_ns=total[..., None, :] * (1e3 / clock_mhz), **beside)


def energy_only(energy_pj: Mapping[str, Floats]) -> Plan:
    """Return the plan of what no chip is meant by: energies, without time, static power or cores."""
    first = next(iter(energy_pj.values()))
    none = np.zeros(first.shape[:-1])
    return Plan(
        energy_pj=energy_pj,
        time_ns=np.zeros((*none.shape, 1, first.shape[-1])),
        static_mw=none,
        idle_mw=none,
        placement=None,
    )
