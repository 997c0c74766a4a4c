"""One inference of a classifier that need not be trained: its work, from counts or means of each layer.

How often neurons are updated is expected from mean rates alone, where it is not counted.

A neuron is updated in a step in which an input arrives or its state is not zero. With a leak that never
reaches exact zero that is from the first arriving input on; a spike arrives one step after it was sent.
Every source fires at random, independently in every step (Bernoulli):

    h_l = 1 - (1 - r_(l-1)) ** n_l                                      something arrives at layer l
    a_l[t] = a_l[t-1] + h_l (a_(l-1)[t-1] - a_l[t-1])                   layer l is awake at step t
    updates_l = size_l sum_t a_l[t]

r_(l-1) mean rate of the layer before, n_l inputs of a neuron; steps count from 1, a_0 = 1 and a_l[1] = 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from dse.base.records import Floats, Operations, Workload
from dse.measure.hardware.cost import Cost, cost, cost_of_steps
from dse.measure.hardware.profile import Profile

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
    """Return an inference of a network, from its mean counts per step, or lists of them.

    Counts of the network itself play no part, and what pruning left is spread evenly. Updates are those that
    mean rates let expect, unless they are given.
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
    return Inference(load, per_step, sum(net.stored or net.dense), n_steps, net.step_ms, pipeline_steps)


def _reached(net: Workload, left: Sequence[float]) -> tuple[float, ...]:
    """Return how many weights other than 0 a spike of each layer reaches, of the shares that are left."""
    forward = [n * share for n, share in zip(net.sizes[1:], left, strict=True)]
    within = [x * back for x, back in zip(forward, net.recurrent, strict=True)]
    return tuple(a + b for a, b in zip((*forward, 0.0), (0.0, *within), strict=True))


def expected_updates(
    sizes: tuple[int, ...], rates: ArrayLike, n_steps: int, fan_in: tuple[float, ...] | None = None
) -> Floats:
    """Return the expected neuron updates of each layer after the input in an inference, (..., layer - 1).

    Args:
        sizes: neurons per layer, input first.
        rates: (..., layer) mean spikes per neuron and step, input first; the last layer's do not matter.
        n_steps: steps of an inference.
        fan_in: inputs of a neuron of each layer after the input; None: the whole layer before.
    """
    rate = np.asarray(rates, np.float64)
    if rate.shape[-1:] != (len(sizes),):
        raise ValueError(f"rates must have shape (..., {len(sizes)}) as sizes, got {rate.shape}")
    if not ((rate >= 0) & (rate <= 1)).all():
        raise ValueError("rates must be between 0 and 1 spikes per neuron and step")
    arrives = 1 - (1 - rate[..., :-1]) ** np.array(sizes[:-1] if fan_in is None else fan_in)
    # A step takes (1, awake, totals) to the next: total += awake, awake += arrives * (awake before - awake).
    n_layers = len(sizes) - 1
    layer = np.arange(n_layers)
    step = np.tile(np.eye(1 + 2 * n_layers), (*rate.shape[:-1], 1, 1))
    step[..., 1 + layer, 1 + layer] -= arrives
    step[..., 1 + layer, layer] += arrives
    step[..., 1 + n_layers + layer, 1 + layer] = 1
    total = np.linalg.matrix_power(step, n_steps)[..., 1 + n_layers :, 0]
    return np.asarray(total * np.array(sizes[1:]))
