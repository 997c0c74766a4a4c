"""How far the states of integer neurons can go: proven from weights, decays and threshold.

The engine's integers have no limit, so C must hold whatever can occur. With P and N the summed positive and
negative weights of a neuron (recurrent ones included; every input spikes at most once per step) and T steps
from rest, truncation only takes away, and a potential above the threshold is reset:

    -N g(d_u) <= u <= P g(d_u),    g(d) = min(T, 4096 / d)
    -N g(d_u) g(d_v) <= v <= threshold + P g(d_u)

A resonator turns by a matrix of norm r = sqrt(c^2 + s^2) / 4096 and is pushed by at most max(P, N):

    |x|, |y| <= max(P, N) min(T, 1 / (1 - r))

Neurons `xylo_lif` saturate: |v| <= 2^15, and u holds a saturated current and the input of one step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dse.base.records import Floats, Ints
from dse.engine.neurons import cuba_lif, resonator, xylo_lif
from dse.engine.neurons.fixed_point import DECAY_SCALE, STATE_SCALE, WEIGHT_SCALE

UNITS_PER_STEP = 2 * STATE_SCALE // WEIGHT_SCALE
"""Units of a state per step of an 8-bit weight."""


@dataclass(frozen=True)
class Bounds:
    """Largest magnitude of the states of a layer, in integer units.

    first: of u or x. second: of v or y.
    """

    first: int
    second: int


def bounds(
    weights: Ints,
    population: cuba_lif.Population | resonator.Population | xylo_lif.Population,
    n_steps: int,
) -> Bounds:
    """Return the bounds of a layer that runs for some steps from rest.

    Args:
        weights: (input, neuron) in 8-bit steps, recurrent inputs included, times the spikes of a step.
        population: the neurons.
        n_steps: network steps.
    """
    if isinstance(population, xylo_lif.Population):
        most = np.abs(weights).sum(axis=0, dtype=np.float64) * (1 << int(population.weight_shift))
        return Bounds(_whole(most - xylo_lif.LOWEST), -xylo_lif.LOWEST)
    positive = np.where(weights > 0, weights, 0).sum(axis=0, dtype=np.float64) * UNITS_PER_STEP
    negative = np.where(weights < 0, -weights, 0).sum(axis=0, dtype=np.float64) * UNITS_PER_STEP
    threshold = float(population.threshold * WEIGHT_SCALE)
    grow_u = _growth(population.decay_current, n_steps)
    grow_v = _growth(population.decay_voltage, n_steps)
    low_u, high_u = negative * grow_u, positive * grow_u
    first = np.maximum(low_u, high_u)
    second = np.maximum(low_u * grow_v, threshold + high_u)
    if isinstance(population, resonator.Population):
        squared = population.cosine.astype(np.float64) ** 2 + population.sine.astype(np.float64) ** 2
        left = 1 - np.sqrt(squared) / DECAY_SCALE
        # A norm of 1 or more does not occur in resonators that `resonator.factors` made.
        growth = np.where(left > 0, np.minimum(n_steps, 1 / np.where(left > 0, left, 1)), np.inf)
        turned = np.maximum(positive, negative) * growth
        first = np.where(population.resonates, turned, first)
        second = np.where(population.resonates, np.maximum(turned, threshold), second)
    return Bounds(_whole(first), _whole(second))


def _growth(decay: Ints, n_steps: int) -> Floats:
    """Return how many times the input of a step a leaking sum can hold."""
    d = np.asarray(decay, np.float64)
    return np.asarray(np.minimum(n_steps, DECAY_SCALE / np.maximum(d, DECAY_SCALE / n_steps)))


def _whole(bound: Floats) -> int:
    """Return the largest bound, rounded up beyond the rounding of its computation."""
    highest = float(np.max(bound, initial=0.0))
    return int(highest * (1 + 1e-9)) + 1 if np.isfinite(highest) else 1 << 62
