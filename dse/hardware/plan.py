"""What a chip asks of one architecture, per count of what happens in an inference.

A kind of hardware compiles an architecture and its figures into a `Plan`; `dse.hardware.cost` multiplies it
with the counts of any number of design points.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dse.records import Operations, Workload

Values = NDArray[np.float64]


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


@dataclass(frozen=True)
class Congestion:
    """Where many spikes go to many cores, queues make a step longer.

    layers: (layer,) bool, whether the spikes of a layer, input first, go to many cores.
    spikes: per step and layer, above which the network is congested.
    factor: (D...) times a step.
    """

    layers: NDArray[np.bool_]
    spikes: float
    factor: Values


@dataclass(frozen=True)
class Plan:
    """Costs of an inference, linear in its F counts (`features`); D... are the draws of the figures.

    energy_pj: cause -> (D..., F), what happening costs.
    time_ns: (D..., K, F); the time of an inference, or of a step, is the largest of K.
    static_mw: (D...), power of the whole chip while it computes.
    idle_mw: (D...), power of the whole chip while it waits.
    placement: None where no chip is meant, so that there are no cores, times and limits either.
    share: of the chip's cores that are in use.
    """

    energy_pj: Mapping[str, Values]
    time_ns: Values
    static_mw: Values
    idle_mw: Values
    placement: Placement | None
    congestion: Congestion | None = None
    share: float = 1.0


def features(load: Workload | Operations) -> Values:
    """Return the counts of a load that a plan is linear in, (..., F).

    Of a workload: steps, spikes of each layer (input first), updates of each layer after it.
    Of operations: 1, multiply-accumulates, additions, state updates.
    """
    if isinstance(load, Operations):
        columns = np.broadcast_arrays(1.0, load.macs, load.additions, load.updates)
        return np.stack(columns, axis=-1).astype(np.float64)
    n_steps = np.asarray(load.n_steps, np.float64)
    spikes = np.asarray(load.spikes, np.float64)
    updates = n_steps[..., None] * np.array(load.sizes[1:]) if load.updates is None else load.updates
    return np.concatenate([n_steps[..., None], spikes, np.asarray(updates, np.float64)], axis=-1)
