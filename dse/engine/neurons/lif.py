"""Leaky integrate-and-fire neurons: membrane potential and nothing else.

    tau_m du/dt = u_rest - u + R_m I(t)                                  Eq. (1) of the source

With I constant over a step of length dt its solution is exact, whatever dt / tau_m is. At step t:

    u[t] = u_rest + k (u_r[t-1] - u_rest) + (1 - k) R_m I[t],   k = exp(-dt / tau_m)
    s[t] = 1 if u[t] > threshold else 0            strictly above: equality does not fire
    u_r[t] = u_rest if s[t] else u[t]              reset to rest, at once

R_m I saturates at +-1e300, so that u stays finite whatever the current. A CUBA-LIF neuron whose current
decays within the step (d_u = 4096) is this one with d_v / 4096 = 1 - k and weights (1 - k) R_m.

Source: threshold encoding for texture recognition, Eq. (1) (REFERENCES.md).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dse.base.records import Array, Bools, Floats
from dse.base.registry import param, register
from dse.engine.neurons import LayerSpec, Neuron, Step
from dse.engine.neurons.calculus import Calculus, NumpyCalculus

LIMIT = 1e300
"""Where R_m I saturates."""


class State(NamedTuple):
    """Membrane potential after reset u, (..., neuron)."""

    u: Array


@dataclass(frozen=True)
class Population:
    """Neurons of a layer, for one length of a step.

    share: 1 - k of the equations.
    r_m, u_rest, threshold: as in `Lif`.
    """

    share: float
    r_m: float
    u_rest: float
    threshold: float

    @property
    def to_threshold(self) -> float:
        """From rest to the threshold."""
        return self.threshold - self.u_rest

    def initial_state(self, shape: tuple[int, ...], calculus: Calculus) -> State:
        """Return neurons at rest."""
        return State(calculus.zeros(shape) + self.u_rest)

    def step(self, state: State, drive: Array, calculus: Calculus) -> Step[State]:
        """Advance by one time step (equations in the module's docstring)."""
        xp = calculus.xp
        limit = min(LIMIT, float(xp.finfo(drive.dtype).max))
        driven = xp.clip(self.r_m * drive, -limit, limit)
        u = self.u_rest + (1 - self.share) * (state.u - self.u_rest) + self.share * driven
        spikes = calculus.fire(u, self.threshold)
        return Step(State(xp.where(spikes > 0, xp.zeros_like(u) + self.u_rest, u)), u, spikes)


@register("neurons", "lif")
@dataclass(frozen=True)
class Lif(Neuron):
    """Leaky integrate-and-fire with one time constant (equations: dse.engine.neurons.lif)."""

    Populations = Population
    label = "leaky integrate-and-fire"

    tau_m_ms: float = param(20.0, low=0, low_open=True, unit="ms", doc="membrane time constant")
    r_m: float = param(1.0, unit="weight per current", doc="membrane resistance")
    u_rest: float = param(0.0, unit="weight", doc="resting potential, to which a spike resets")
    threshold: float = param(1.0, unit="weight", doc="firing threshold, above u_rest")

    def __post_init__(self) -> None:
        """Refuse what is no neuron."""
        for name, value in vars(self).items():
            if not math.isfinite(value):
                raise ValueError(f"{name} must be finite, got {value}")
        if not self.tau_m_ms > 0:
            raise ValueError(f"tau_m_ms must be > 0, got {self.tau_m_ms}")
        if not self.threshold > self.u_rest:
            raise ValueError(f"threshold must be above u_rest ({self.u_rest}), got {self.threshold}")

    def population(self, layer: LayerSpec, rng: np.random.Generator) -> Population:
        """Return a layer's neurons, all alike."""
        return self.at(layer.step_ms)

    def at(self, step_ms: float) -> Population:
        """Return the neurons for steps of one length."""
        return Population(leak(step_ms, self.tau_m_ms), self.r_m, self.u_rest, self.threshold)


def leak(step_ms: float, tau_m_ms: float) -> float:
    """Return 1 - exp(-dt / tau_m): the share of the way to its end that u goes in a step.

    Raises:
        ValueError: a time is not positive.
    """
    if not (step_ms > 0 and tau_m_ms > 0):
        raise ValueError(f"step_ms and tau_m_ms must be > 0, got {step_ms} and {tau_m_ms}")
    return -math.expm1(-step_ms / tau_m_ms)


def run(current: Floats, neuron: Lif, step_ms: float) -> tuple[Floats, Bools]:
    """Run neurons over time from rest.

    Args:
        current: (sample, step, neuron).
        neuron: its parameters.
        step_ms: length of a step.

    Returns:
        Membrane potential before reset (float64) and spikes (bool), each (sample, step, neuron).

    Raises:
        ValueError: a current is not finite.
    """
    if not np.isfinite(current).all():
        raise ValueError(f"current must be finite, got {current[~np.isfinite(current)][0]}")
    calculus, population = NumpyCalculus("ideal"), neuron.at(step_ms)
    state = population.initial_state((current.shape[0], current.shape[2]), calculus)
    potential, spikes = np.zeros(current.shape), np.zeros(current.shape, bool)
    for t in range(current.shape[1]):
        with np.errstate(over="ignore"):  # saturates, as the docstring says
            state, potential[:, t], spikes[:, t] = population.step(
                state, np.asarray(current[:, t], np.float64), calculus
            )
    return potential, spikes
