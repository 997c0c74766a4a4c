"""One inference of a classifier that need not be trained: its work, from counts or means of each layer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dse.hardware.activity import expected_updates
from dse.hardware.cost import Cost, cost, cost_of_steps
from dse.hardware.profile import Profile
from dse.records import Floats, Operations, Workload

PerStep = float | Floats
"""A mean, which stands for the same count in every step, or (n_steps,) counts."""


@dataclass(frozen=True)
class Inference:
    """What a classifier does in one inference, to be priced.

    load: the mean work of one inference; if `per_step`, its arrays have a leading axis of steps, as
        `cost_of_steps` takes them.
    n_weights: W_t, weights or other numbers that are stored.
    n_steps, step_ms: steps and their period; a classifier that is no network has one step, its whole input.
    pipeline_steps: steps that the answer still takes through the layers; None: what the hardware takes.
    """

    load: Workload | Operations
    per_step: bool
    n_weights: int
    n_steps: int
    step_ms: float
    pipeline_steps: int | None = None

    @property
    def decision_ms(self) -> float:
        """Time on the sensor's clock until the input is complete."""
        return self.n_steps * self.step_ms

    def counts_on(self, profile: Profile) -> Floats:
        """Return what happens in the whole inference on this hardware, (F,)."""
        counts = profile.counts(self.load)
        return np.asarray(counts.sum(axis=0)) if self.per_step else counts

    def on(self, profile: Profile) -> Workload | Operations:
        """Return the load with the steps that its answer takes through the layers on this hardware."""
        if not isinstance(self.load, Workload) or not self.n_steps:
            return self.load
        stated = self.pipeline_steps
        steps = profile.pipeline_steps(self.load) if stated is None else stated
        return replace(self.load, pipeline_steps=steps)

    def cost_on(self, profile: Profile) -> Cost:
        """Return what the inference costs (`cost`, or `cost_of_steps` from counts of each step)."""
        load = self.on(profile)
        if self.per_step and isinstance(load, Workload):
            return cost_of_steps(profile, load)
        return cost(profile, load)


def of_network(
    net: Workload,
    n_steps: int,
    spikes: Sequence[PerStep],
    updates: Sequence[PerStep] | None,
    pipeline_steps: int | None = None,
) -> Inference:
    """Return an inference of a network.

    Args:
        net: the network; its counts play no part, and what pruning left is spread evenly.
        n_steps: of the inference.
        spikes: per step of each layer, input first.
        updates: per step of each layer after the input; None: as the mean rates let expect.
        pipeline_steps: of the inference.
    """
    left = [a / b for a, b in zip(net.stored or net.dense, net.dense, strict=True)]
    if updates is None:
        sizes = np.array(net.sizes)
        rates = [np.mean(x) if n_steps else 0.0 for x in spikes] / sizes
        fan_in = tuple(n * share for n, share in zip(net.sizes, left, strict=False))
        expected = expected_updates(net.sizes, np.minimum(rates, 1.0), n_steps, fan_in)
        updates = list(expected / max(n_steps, 1))
    per_step = n_steps > 0 and any(isinstance(x, np.ndarray) for x in (*spikes, *updates))
    # Steps of an inference, one by one; or all of them as one entry.
    steps = np.ones(n_steps) if per_step else np.asarray(float(n_steps))

    def laid_out(counts: Sequence[PerStep]) -> Floats:
        return np.stack([steps * (x if n_steps else 0.0) for x in counts], axis=-1)

    load = replace(
        net,
        n_steps=steps,
        spikes=laid_out(spikes),
        updates=laid_out(updates),
        synapses=None if net.stored is None else _reached(net, left),
    )
    n_weights = sum(net.dense if net.stored is None else net.stored)
    return Inference(load, per_step, n_weights, n_steps, net.step_ms, pipeline_steps)


def _reached(net: Workload, left: Sequence[float]) -> tuple[float, ...]:
    """Return how many weights other than 0 a spike of each layer reaches.

    Args:
        net: the network.
        left: share of the weights into each layer that pruning left.
    """
    forward = [n * share for n, share in zip(net.sizes[1:], left, strict=True)]
    within = [x * back for x, back in zip(forward, net.recurrent, strict=True)]
    return tuple(a + b for a, b in zip((*forward, 0.0), (0.0, *within), strict=True))
