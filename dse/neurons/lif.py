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

import numpy as np

from dse.records import Array

LIMIT = 1e300
"""Where R_m I saturates."""


@dataclass(frozen=True)
class Params:
    """Parameters of a population.

    tau_m_ms: membrane time constant.
    r_m: resistance, in units of u per unit of current.
    u_rest, threshold: resting potential, where a spike resets to, and what u must exceed to spike.
    """

    tau_m_ms: float
    r_m: float = 1.0
    u_rest: float = 0.0
    threshold: float = 1.0

    def __post_init__(self) -> None:
        """Refuse what is no neuron."""
        for name, value in vars(self).items():
            if not math.isfinite(value):
                raise ValueError(f"{name} must be finite, got {value}")
        if not self.tau_m_ms > 0:
            raise ValueError(f"tau_m_ms must be > 0, got {self.tau_m_ms}")
        if not self.threshold > self.u_rest:
            raise ValueError(f"threshold must be above u_rest ({self.u_rest}), got {self.threshold}")


@dataclass(frozen=True)
class State:
    """Membrane potential after reset u, (..., neuron) float64."""

    u: Array


def initial_state(shape: tuple[int, ...], population: Params) -> State:
    """Return the resting state of the given shape, neurons last."""
    return State(np.full(shape, population.u_rest, np.float64))


def leak(step_ms: float, tau_m_ms: float) -> float:
    """Return 1 - exp(-dt / tau_m): the share of the way to its end that u goes in a step.

    Raises:
        ValueError: a time is not positive.
    """
    if not (step_ms > 0 and tau_m_ms > 0):
        raise ValueError(f"step_ms and tau_m_ms must be > 0, got {step_ms} and {tau_m_ms}")
    return -math.expm1(-step_ms / tau_m_ms)


def step(state: State, current: Array, population: Params, step_ms: float) -> tuple[State, Array, Array]:
    """Advance a population by one time step (equations in the module's docstring).

    Args:
        state: reset u at t - 1, (..., neuron).
        current: I at t, (..., neuron).
        population: parameters.
        step_ms: length of the step.

    Returns:
        The state at t, u before reset, and the spikes s[t] as booleans.

    Raises:
        ValueError: a current is not finite.
    """
    current = np.asarray(current, np.float64)
    if not np.isfinite(current).all():
        raise ValueError(f"current must be finite, got {current[~np.isfinite(current)][0]}")
    with np.errstate(over="ignore"):  # saturates, as the docstring says
        drive = np.clip(population.r_m * current, -LIMIT, LIMIT)
    share = leak(step_ms, population.tau_m_ms)
    u = population.u_rest + (1 - share) * (state.u - population.u_rest) + share * drive
    fired = u > population.threshold
    return State(np.where(fired, population.u_rest, u)), u, fired


def run(current: Array, population: Params, step_ms: float) -> tuple[Array, Array]:
    """Run a population over time from rest.

    Args:
        current: (sample, step, neuron).
        population: parameters.
        step_ms: length of a step.

    Returns:
        Membrane potential before reset (float64) and spikes (bool), each (sample, step, neuron).
    """
    state = initial_state((current.shape[0], current.shape[2]), population)
    potential, spikes = np.zeros(current.shape), np.zeros(current.shape, bool)
    for t in range(current.shape[1]):
        state, potential[:, t], spikes[:, t] = step(state, current[:, t], population, step_ms)
    return potential, spikes
