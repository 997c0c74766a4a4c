"""A neuron of a user: a leaky integrator whose threshold rises with every spike and falls back."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dse.base.records import Array, Floats
from dse.base.registry import param, register
from dse.engine.neurons import LayerSpec, Neuron, Step
from dse.engine.neurons.calculus import Calculus


class State(NamedTuple):
    """Potential v after reset and adaptation a."""

    v: Array
    a: Array


@dataclass(frozen=True)
class Population:
    """keep_v: (neuron,) factor of v per step. keep_a: of a. rise: what a spike adds to a."""

    keep_v: Floats
    keep_a: float
    threshold: float
    rise: float

    @property
    def to_threshold(self) -> float:
        return self.threshold

    def initial_state(self, shape: tuple[int, ...], calculus: Calculus) -> State:
        return State(calculus.zeros(shape), calculus.zeros(shape))

    def step(self, state: State, drive: Array, calculus: Calculus) -> Step[State]:
        v = self.keep_v * state.v + drive
        spikes = calculus.fire(v, self.threshold + state.a)
        a = self.keep_a * state.a + self.rise * calculus.constant(spikes)
        return Step(State(v * (1 - calculus.constant(spikes)), a), v, spikes)


@register("neurons", "adaptive")
@dataclass(frozen=True)
class Adaptive(Neuron):
    """Leaky integrator with adaptation.

    v[t] = exp(-dt / tau_v) v_r[t-1] + z[t];   s[t] = 1 where v[t] > threshold + a[t-1]
    a[t] = exp(-dt / tau_a) a[t-1] + rise s[t];   v_r[t] = 0 after a spike, else v[t]
    """

    Populations = Population
    label = "leaky integrate-and-adapt"
    state_updates = 2

    tau_v_ms: tuple[float, ...] = param((10.0, 300.0), low=0, low_open=True, unit="ms", doc="two bounds")
    tau_a_ms: float = param(40.0, low=0, low_open=True, unit="ms", doc="time constant of the adaptation")
    rise: float = param(0.2, low=0, unit="weight", doc="what a spike adds to the threshold")
    threshold: float = param(1.0, low=0, low_open=True, unit="weight", doc="firing threshold at rest")

    def population(self, layer: LayerSpec, rng: np.random.Generator) -> Population:
        low, high = (math.log(tau) for tau in (self.tau_v_ms[0], self.tau_v_ms[-1]))
        tau = np.exp(
            np.full(layer.n_neurons, high) if layer.is_output else rng.uniform(low, high, layer.n_neurons)
        )
        return Population(
            keep_v=np.exp(-layer.step_ms / tau),
            keep_a=math.exp(-layer.step_ms / self.tau_a_ms),
            threshold=self.threshold,
            rise=0.0 if layer.is_output else self.rise,
        )
