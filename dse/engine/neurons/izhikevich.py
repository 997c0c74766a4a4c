"""Izhikevich's neuron: a quadratic membrane potential with an adaptation, both reset at a spike.

With v in mV, time in ms and I the input current:

    v' = A v^2 + B v + C - u + D I                                           Eq. (1), A, B, C, D printed
    u' = a (b v - u)                                                         Eq. (2)
    if v >= 30 mV: a spike; v = c, u = u + d                                 Eq. (3)

One step of length h, of either method; hold(x) = min(max(x, FLOOR_MV), PEAK_MV):

    euler        v1 = v + h v'(v, u);                      u1 = u + h u'(v, u)
    half_steps   w = hold(v + h/2 v'(v, u)), v1 = w + h/2 v'(w, u);  u1 = u + h u'(hold(v1), u)
    then         a spike where v1 >= PEAK_MV: v = c, u = u1 + d;  else v = max(v1, FLOOR_MV), u = u1

It saturates at one spike per step, whatever the current: v enters a square only between FLOOR_MV and
PEAK_MV, so nothing overflows, and an infinite current is a large one. Below FLOOR_MV the slope of v' is
steeper than -2 / ms, where Euler steps of 1 ms swing ever wider about the resting point and end in spikes
that no current asked for. v is held there; it comes back as u decays. `reference` knows no floor.

It makes the spikes of simulated receptors (dse.data.encoders.receptors). No network is trained of it: the
slope of v' grows without bound towards the peak, and with it every gradient through an Euler step.

The table of the source prints c = -0.65; it is -65 mV, as in Izhikevich's own paper and in its figures.
Sources: Izhikevich, IEEE Trans. Neural Netw. 14, 2003, and its published script (half_steps); Rasouli et al.,
an extreme learning machine for texture recognition, Eqs. (1)-(3), Table II (REFERENCES.md).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from dse.base.records import Array

A, B, C, D = 0.04, 5.0, 140.0, 1.0
PEAK_MV = 30.0
FLOOR_MV = -87.5
"""Where 2 A v + B = -2 / ms."""

Method = Literal["euler", "half_steps"]
METHODS = ("euler", "half_steps")


@dataclass(frozen=True)
class Params:
    """Parameters of a population; each a number or (neuron,).

    a: decay of the adaptation, per ms. b: its sensitivity to v.
    c: v after a spike, mV. d: what a spike adds to u.
    """

    a: float | Array
    b: float | Array
    c: float | Array
    d: float | Array


SA = Params(a=0.02, b=0.2, c=-65.0, d=8.0)
"""Regular spiking: slowly adapting receptors."""
FA = Params(a=0.1, b=0.2, c=-65.0, d=2.0)
"""Fast spiking: fast adapting receptors."""


@dataclass(frozen=True)
class State:
    """Membrane potential v (mV) and adaptation u, (..., neuron) float64."""

    v: Array
    u: Array


def initial_state(shape: tuple[int, ...], params: Params) -> State:
    """Return v = c and u = b c, from where a neuron without current settles at -70 mV and stays silent."""
    v = np.zeros(shape) + params.c
    return State(v, params.b * v)


def slope(v: Array, u: Array, current: Array | float) -> Array:
    """Return v' of Eq. (1), in mV / ms."""
    return np.asarray((A * v + B) * v + C - u + D * current)


def adaptation_slope(v: Array, u: Array, params: Params) -> Array:
    """Return u' of Eq. (2), per ms."""
    return np.asarray(params.a * (params.b * v - u))


def step(
    state: State, current: Array, params: Params, step_ms: float = 1.0, method: Method = "euler"
) -> tuple[State, Array]:
    """Advance neurons by one step.

    Args:
        state: v and u, (..., neuron).
        current: during the step, (..., neuron); infinite ones saturate.
        params: of the population.
        step_ms: h.
        method: 'euler' or 'half_steps'.

    Returns:
        The state after the step, and (..., neuron) bool, which neurons spiked.

    Raises:
        ValueError: a current is NaN, the step is not positive or the method is unknown.
    """
    if np.isnan(current).any():
        raise ValueError(f"current must be numbers, got NaN in {int(np.isnan(current).sum())} places")
    if not 0 < step_ms < np.inf:
        raise ValueError(f"step_ms must be > 0, got {step_ms}")
    if method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}, got '{method}'")
    v, u = state.v, state.u
    if method == "euler":
        new = v + step_ms * slope(v, u, current)
        adapted = u + step_ms * adaptation_slope(v, u, params)
    else:
        half = _held(v + 0.5 * step_ms * slope(v, u, current))
        new = half + 0.5 * step_ms * slope(half, u, current)
        adapted = u + step_ms * adaptation_slope(_held(new), u, params)
    spiked = new >= PEAK_MV
    return State(
        np.where(spiked, params.c, np.maximum(new, FLOOR_MV)), np.where(spiked, adapted + params.d, adapted)
    ), spiked


def _held(v: Array) -> Array:
    return np.asarray(np.minimum(np.maximum(v, FLOOR_MV), PEAK_MV))


def simulate(current: Array, params: Params, step_ms: float = 1.0, method: Method = "euler") -> Array:
    """Return the spikes of neurons from `initial_state` on, (step, neuron) bool.

    Args:
        current: (step, neuron), one row per step of `step_ms`.
        params: of the population.
        step_ms: length of a step.
        method: 'euler' or 'half_steps'.

    Raises:
        ValueError: as for `step`.
    """
    state = initial_state(np.shape(current)[1:], params)
    spikes = np.zeros(np.shape(current), dtype=bool)
    for t, now in enumerate(current):
        state, spikes[t] = step(state, now, params, step_ms, method)
    return spikes


def reference(current: Array, params: Params, step_ms: float = 1.0, tolerance: float = 1e-9) -> Array:
    """Return the spike times of one neuron by an adaptive Runge-Kutta method of order 8, (spike,) ms.

    Each spike ends an integration exactly at 30 mV and begins the next from the reset state, so that the work
    grows with the spikes; nothing saturates and v has no floor.

    Args:
        current: (step,) finite, constant over each step.
        params: numbers.
        step_ms: length of a step of the current.
        tolerance: relative error of the integration; the absolute one is the same in mV.

    Raises:
        ValueError: a current is not finite.
        ArithmeticError: the integration failed.
    """
    from scipy.integrate import solve_ivp

    if not np.isfinite(current).all():
        raise ValueError(f"current must be finite, got {int((~np.isfinite(current)).sum())} other values")

    def derivative(_t: float, x: Array, now: float) -> Array:
        return np.array([slope(x[0], x[1], now), adaptation_slope(x[0], x[1], params)])

    def peak(_t: float, x: Array, _now: float) -> float:
        return float(x[0] - PEAK_MV)

    peak.terminal, peak.direction = True, 1.0  # type: ignore[attr-defined]
    start = initial_state((), params)
    x, times = np.array([start.v, start.u]), []
    for k, now in enumerate(current):
        t, end = k * step_ms, (k + 1) * step_ms
        while t < end:
            solution = solve_ivp(
                derivative, (t, end), x, "DOP853", args=(float(now),), events=peak,
                rtol=tolerance, atol=tolerance,
            )  # fmt: skip
            if solution.status < 0:
                raise ArithmeticError(f"no solution after {t:g} ms: {solution.message}")
            t, x = float(solution.t[-1]), solution.y[:, -1]
            if solution.status == 1:
                times.append(t)
                x = np.array([params.c, x[1] + params.d])
    return np.array(times)
