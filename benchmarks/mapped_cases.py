"""Spiking networks that run on a simulated chip: the same weights and spikes in every process.

Leaky neurons as SANA-FE has Loihi's, spike for spike; what is sent in a step arrives in the next:

    v[t] = 29/32 v[t-1], cut to 1/64, + sum of weights of spikes at t-1;  fires where v > 1; then v falls by 1

NumPy is all that is needed: another environment's Python builds the same case.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

LEAK = 29 / 32
BURST_STEPS, BURST_EVERY = 10, 50
_GRID = 2.0**-16  # weights on it add up exactly, in any order


@dataclass(frozen=True)
class Case:
    """A network of layers, its input first, with random weights and input spikes.

    recurrent: per layer after the input.
    input_rate, rate: spikes per input or (roughly) neuron, and step.
    weights_left: share of the weights that pruning leaves.
    bursty: all input comes in 10 of every 50 steps.
    """

    sizes: tuple[int, ...]
    recurrent: tuple[bool, ...]
    n_steps: int
    input_rate: float
    rate: float
    weights_left: float = 1.0
    bursty: bool = False

    @cached_property
    def inputs(self) -> np.ndarray:
        """Input spikes (step, input)."""
        rate = np.full(self.n_steps, self.input_rate)
        if self.bursty:
            busy = np.arange(self.n_steps) % BURST_EVERY < BURST_STEPS
            rate = np.where(busy, rate * BURST_EVERY / BURST_STEPS, 0.0)
        return np.random.default_rng(0).random((self.n_steps, self.sizes[0])) < rate[:, None]

    @cached_property
    def weights(self) -> tuple[np.ndarray, ...]:
        """Weights (source, neuron) into each layer; the sources of a recurrent one are followed by itself."""
        rng, weights, rate = np.random.default_rng(1), [], self.input_rate
        for before, n, back in zip(self.sizes, self.sizes[1:], self.recurrent, strict=False):
            # What a neuron that is half full leaks, and what it fires: on average, that comes in.
            mean = (self.rate + 0.5 * (1 - LEAK)) / (before * rate * self.weights_left)
            weight = rng.normal(mean, mean / 2, (before, n))
            if back:
                weight = np.concatenate([weight, rng.normal(0, mean / 2, (n, n))])
            weights.append(np.rint(weight / _GRID) * _GRID)
            rate = self.rate
        return tuple(
            np.where(connected, weight, 0.0)
            for connected, weight in zip(self.connected, weights, strict=True)
        )

    @cached_property
    def connected(self) -> tuple[np.ndarray, ...]:
        """Which weights there are, those that happen to be 0 included; bool, shaped as `weights`."""
        rng = np.random.default_rng(2)
        layers = zip(self.sizes, self.sizes[1:], self.recurrent, strict=False)
        return tuple(rng.random((before + n * back, n)) < self.weights_left for before, n, back in layers)

    @cached_property
    def targets(self) -> tuple[np.ndarray, ...]:
        """Neurons that each unit of a layer, input first, reaches."""
        targets = [np.zeros(n, np.int64) for n in self.sizes]
        for k, (connected, before) in enumerate(zip(self.connected, self.sizes, strict=False)):
            targets[k] += connected[:before].sum(axis=1)
            if self.recurrent[k]:
                targets[k + 1] += connected[before:].sum(axis=1)
        return tuple(targets)

    @cached_property
    def activity(self) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Spikes of each layer, input first, and neurons updated in each after it, (step, neuron) bool.

        A neuron is updated where its potential is not 0 or a spike reached it.
        """
        potential = [np.zeros(n) for n in self.sizes[1:]]
        fired = [np.zeros((self.n_steps, n), bool) for n in self.sizes]
        updated = [np.zeros((self.n_steps, n), bool) for n in self.sizes[1:]]
        fired[0][:] = self.inputs
        for t in range(self.n_steps):
            for k, back in enumerate(self.recurrent):
                came = [fired[k][t - 1], fired[k + 1][t - 1]] if back else [fired[k][t - 1]]
                sources = np.flatnonzero(np.concatenate(came)) if t else np.zeros(0, np.int64)
                updated[k][t] = (potential[k] != 0) | self.connected[k][sources].any(axis=0)
                left = np.trunc(LEAK * potential[k] * 64) / 64
                potential[k] = left + self.weights[k][sources].sum(axis=0)
                fired[k + 1][t] = potential[k] > 1
                potential[k] -= fired[k + 1][t]
        return fired, updated
