"""Current-based leaky integrate-and-fire neurons, as SLAYER trains them and Loihi runs them.

With trunc = toward zero, decays d in 1/4096 and weights on a grid of 1/64, at step t:

    u[t] = leak(u[t-1], d_u) + z[t]                current; z = weighted input spikes
    v[t] = leak(v_r[t-1], d_v) + u[t]              membrane potential, same-step current
    s[t] = 1 if v[t] > threshold else 0            strictly above: equality does not fire
    v_r[t] = 0 if s[t] else v[t]                   hard reset; u is not reset

`integer` arithmetic holds u and v as integers in units of 1/4096 and leaks by
sign(x) * ((|x| * (4096 - d)) >> 12); this is what the chip does. `ideal` arithmetic uses real
numbers and leak(x, d) = x * (4096 - d) / 4096. A layer hands its spikes on one step later.

Source: lava-dl SLAYER CUBA neuron and dense block; Davies et al. 2018 (REFERENCES.md).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from dse.neurons.fixed_point import (
    DECAY_SCALE,
    STATE_LIMIT,
    STATE_SCALE,
    WEIGHT_SCALE,
    quantise,
    quantise_passes,
)
from dse.records import Array

__all__ = ["DECAY_SCALE", "STATE_LIMIT", "STATE_SCALE", "WEIGHT_SCALE", "quantise", "quantise_passes"]

Arithmetic = Literal["integer", "ideal"]


@dataclass(frozen=True)
class Params:
    """Parameters of a population.

    decay_current, decay_voltage: integer decays in [0, 4096], scalar or (neuron,).
    threshold: integer mantissa; the real threshold is threshold / 64.
    """

    decay_current: Array
    decay_voltage: Array
    threshold: int


@dataclass(frozen=True)
class State:
    """Current u and membrane potential after reset v, (..., neuron): float64 (ideal) or int64 (integer)."""

    u: Array
    v: Array


def params(current_decay: float, voltage_decay: float, threshold: float) -> Params:
    """Round real parameters to the chip's grid: decays half to even, threshold down.

    Raises:
        ValueError: a decay lies outside [0, 1], or the threshold rounds to less than 1/64.
    """
    for name, decay in (("current_decay", current_decay), ("voltage_decay", voltage_decay)):
        if not 0 <= decay <= 1:
            raise ValueError(f"{name} must be within [0, 1], got {decay}")
    return Params(round_decay(current_decay), round_decay(voltage_decay), round_threshold(threshold))


def round_decay(decay: Array | float) -> Array:
    """Return the 12-bit integer decay, rounded half to even in float32 as SLAYER does."""
    return np.clip(np.round(np.float32(DECAY_SCALE) * np.asarray(decay, np.float32)), 0, DECAY_SCALE).astype(
        np.int32
    )


def round_threshold(threshold: float) -> int:
    """Return the threshold's integer mantissa: floor(64 * threshold).

    Raises:
        ValueError: the mantissa would be below 1.
    """
    mantissa = int(WEIGHT_SCALE * threshold)
    if mantissa < 1:
        raise ValueError(f"threshold must be at least 1/64, got {threshold}")
    return mantissa


def initial_state(shape: tuple[int, ...], arithmetic: Arithmetic) -> State:
    """Return the resting state (all zeros) of the given shape, neurons last."""
    kind = np.int64 if arithmetic == "integer" else np.float64
    return State(np.zeros(shape, kind), np.zeros(shape, kind))


def leak(x: Array, decay: Array) -> Array:
    """Return x after one step of leak; truncates toward zero where x is an integer array."""
    if x.dtype.kind != "i":
        return np.asarray(x * ((DECAY_SCALE - decay) / DECAY_SCALE))
    product = x * (DECAY_SCALE - decay).astype(np.int64)
    return np.asarray(np.sign(product) * (np.abs(product) >> 12))


def step(state: State, z: Array, population: Params) -> tuple[State, Array, Array]:
    """Advance a population by one time step (equations in the module's docstring).

    Args:
        state: u and reset v at t - 1, each (..., neuron).
        z: weighted input at t in weight units, (..., neuron).
        population: decays and threshold.

    Returns:
        The state at t, the membrane potential before reset (same units as the state), and
        the spikes s[t] as booleans.
    """
    if state.u.dtype.kind == "i":
        drive = np.trunc(np.asarray(z, np.float64) * STATE_SCALE).astype(np.int64)
        threshold: float = population.threshold * (STATE_SCALE // WEIGHT_SCALE)
    else:
        drive = np.asarray(z, np.float64)
        threshold = population.threshold / WEIGHT_SCALE
    u = leak(state.u, population.decay_current) + drive
    v = leak(state.v, population.decay_voltage) + u
    fired = v > threshold
    return State(u, np.where(fired, np.zeros_like(v), v)), v, fired


def run(z: Array, population: Params, arithmetic: Arithmetic) -> tuple[Array, Array, Array]:
    """Run a population over time from rest.

    Args:
        z: weighted input, (sample, step, neuron), weight units.
        population: decays and threshold.
        arithmetic: 'integer' or 'ideal'.

    Returns:
        Current, membrane potential before reset (both float64 in weight units) and spikes (bool),
        each (sample, step, neuron).
    """
    state = initial_state((z.shape[0], z.shape[2]), arithmetic)
    scale = STATE_SCALE if arithmetic == "integer" else 1
    current, voltage = np.zeros(z.shape), np.zeros(z.shape)
    spikes = np.zeros(z.shape, bool)
    for t in range(z.shape[1]):
        state, v, spikes[:, t] = step(state, z[:, t], population)
        current[:, t], voltage[:, t] = state.u / scale, v / scale
    return current, voltage, spikes


def shift(spikes: Array) -> Array:
    """Delay spikes (sample, step, neuron) by one step; the last step's spikes are lost."""
    out = np.zeros_like(spikes)
    out[:, 1:] = spikes[:, :-1]
    return out


def backward(grad_spikes: Array, surrogate_gradient: Array, population: Params) -> Array:
    """Return dL/dz of a population: leaky integration backward in time, the reset ignored.

        lv[t] = (1 - d_v) lv[t+1] + dL/ds[t] * ds/dv[t];   lu[t] = (1 - d_u) lu[t+1] + lv[t] = dL/dz[t]

    Truncation and rounding are straight-through. Arrays are (sample, step, neuron).
    """
    keep_u = (DECAY_SCALE - population.decay_current) / DECAY_SCALE
    keep_v = (DECAY_SCALE - population.decay_voltage) / DECAY_SCALE
    lv = np.zeros(grad_spikes.shape[::2])
    lu = np.zeros_like(lv)
    out = np.zeros(grad_spikes.shape)
    for t in range(grad_spikes.shape[1] - 1, -1, -1):
        lv = keep_v * lv + grad_spikes[:, t] * surrogate_gradient[:, t]
        lu = keep_u * lu + lv
        out[:, t] = lu
    return out
