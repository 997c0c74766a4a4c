"""Plain definitions that the engine and the neurons are checked against: slow, over dense arrays."""

from __future__ import annotations

import numpy as np

from dse.neurons.calculus import NumpyCalculus
from dse.neurons.cuba_lif import Population, round_decay, round_threshold
from dse.neurons.fixed_point import DECAY_SCALE, HIGHEST_WEIGHT, LOWEST_WEIGHT, STATE_SCALE, WEIGHT_SCALE
from dse.neurons.izhikevich import PEAK_MV, Method, Params, adaptation_slope, initial_state, slope, step
from dse.neurons.lif import Lif
from dse.neurons.resonator import Population as Resonators
from dse.records import Arithmetic, Array, Bools, Floats


def rounded(current_decay: float, voltage_decay: float, threshold: float) -> Population:
    """Return neurons with real parameters rounded to the grid: decays half to even, threshold down.

    Raises:
        ValueError: a decay lies outside [0, 1], or the threshold rounds to less than 1/64.
    """
    for name, decay in (("current_decay", current_decay), ("voltage_decay", voltage_decay)):
        if not 0 <= decay <= 1:
            raise ValueError(f"{name} must be within [0, 1], got {decay}")
    return Population(round_decay(current_decay), round_decay(voltage_decay), round_threshold(threshold))


def run_cuba(z: Floats, population: Population, arithmetic: Arithmetic) -> tuple[Floats, Floats, Bools]:
    """Run a population over time from rest.

    Args:
        z: weighted input, (sample, step, neuron), weight units.
        population: decays and threshold.
        arithmetic: of the states.

    Returns:
        Current, membrane potential before reset (both float64 in weight units) and spikes,
        each (sample, step, neuron).
    """
    calculus = NumpyCalculus(arithmetic)
    state = population.initial_state((z.shape[0], z.shape[2]), calculus)
    scale = STATE_SCALE if arithmetic == "integer" else 1
    current, voltage = np.zeros(z.shape), np.zeros(z.shape)
    spikes = np.zeros(z.shape, bool)
    for t in range(z.shape[1]):
        state, voltage[:, t], spikes[:, t] = population.step(state, z[:, t], calculus)
        current[:, t] = state.u / scale
    return current, voltage, spikes


def shift(spikes: Array) -> Array:
    """Delay spikes (sample, step, neuron) by one step; the last step's spikes are lost."""
    out = np.zeros_like(spikes)
    out[:, 1:] = spikes[:, :-1]
    return out


def backward(grad_spikes: Floats, surrogate_gradient: Floats, population: Population) -> Floats:
    """Return dL/dz of a population: leaky integration backward in time, the reset ignored.

        lv[t] = (1 - d_v) lv[t+1] + dL/ds[t] * ds/dv[t];   lu[t] = (1 - d_u) lu[t+1] + lv[t] = dL/dz[t]

    Truncation and rounding are straight-through. Arrays are (sample, step, neuron).
    """
    keep_u, keep_v = population.keep
    lv = np.zeros(grad_spikes.shape[::2])
    lu = np.zeros_like(lv)
    out = np.zeros(grad_spikes.shape)
    for t in range(grad_spikes.shape[1] - 1, -1, -1):
        lv = keep_v * lv + grad_spikes[:, t] * surrogate_gradient[:, t]
        lu = keep_u * lu + lv
        out[:, t] = lu
    return out


def resonators_backward(grad_spikes: Floats, surrogate_gradient: Floats, population: Resonators) -> Floats:
    """Return dL/dz of a population: the transposed steps backward in time, the reset ignored.

        X[t] = c X[t+1] + s Y[t+1] = dL/dz[t];   Y[t] = -s X[t+1] + c Y[t+1] + dL/ds[t] * ds/dy[t]

    of a resonator; of the others as in dse.neurons.cuba_lif. Truncation and rounding are straight-through.
    Arrays are (sample, step, neuron).
    """
    out = np.array(
        backward(
            grad_spikes,
            surrogate_gradient,
            Population(population.decay_current, population.decay_voltage, population.threshold),
        )
    )
    is_resonator = population.resonates
    c, s = (np.asarray(f, np.float64) / DECAY_SCALE for f in (population.cosine, population.sine))
    x = np.zeros(grad_spikes.shape[::2])
    y = np.zeros_like(x)
    for t in range(grad_spikes.shape[1] - 1, -1, -1):
        x, y = c * x + s * y, -s * x + c * y + grad_spikes[:, t] * surrogate_gradient[:, t]
        out[:, t, is_resonator] = x[:, is_resonator]
    return out


def run_lif(current: Floats, neuron: Lif, step_ms: float) -> tuple[Floats, Bools]:
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


def quantise_passes(weight: Array) -> Bools:
    """Return where the straight-through gradient of `quantise` survives: inside the clip, ends included."""
    grid = np.float32(2 / WEIGHT_SCALE)
    rounded = np.round(np.asarray(weight, np.float32) / grid) * grid
    return np.asarray((rounded >= LOWEST_WEIGHT) & (rounded <= HIGHEST_WEIGHT))
