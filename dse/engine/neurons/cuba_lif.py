"""Current-based leaky integrate-and-fire neurons, as SLAYER trains them and Loihi runs them.

With trunc = toward zero, decays d in 1/4096 and weights on a grid of 1/64, at step t:

    u[t] = leak(u[t-1], d_u) + z[t]                current; z = weighted input spikes
    v[t] = leak(v_r[t-1], d_v) + u[t]              membrane potential, same-step current
    s[t] = 1 if v[t] > threshold else 0            strictly above: equality does not fire
    v_r[t] = 0 if s[t] else v[t]                   hard reset; u is not reset

`integer` arithmetic holds u and v as integers in units of 1/4096 and leaks by
sign(x) * ((|x| * (4096 - d)) >> 12); this is what the chip does. Real arithmetic leaks by
leak(x, d) = x * (4096 - d) / 4096. A layer hands its spikes on one step later.

Backward in time the reset is ignored and truncation passes straight through, as in SLAYER (`backward`).

Source: lava-dl SLAYER CUBA neuron and dense block; Davies et al. 2018 (REFERENCES.md).
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple

import numpy as np

from dse.base.records import Arithmetic, Array, Bools, Floats, Ints
from dse.base.registry import param, register
from dse.engine.neurons import LayerSpec, Neuron, Step
from dse.engine.neurons.calculus import Calculus, NumpyCalculus
from dse.engine.neurons.fixed_point import DECAY_SCALE, STATE_SCALE, WEIGHT_SCALE


class State(NamedTuple):
    """Current u and membrane potential after reset v, (..., neuron); in integer arithmetic in 1/4096."""

    u: Array
    v: Array


@dataclass(frozen=True)
class Population:
    """Neurons of a layer.

    decay_current, decay_voltage: integer decays per network step in [0, 4096], scalar or (neuron,).
    threshold: integer mantissa; the real threshold is threshold / 64.
    """

    decay_current: Ints
    decay_voltage: Ints
    threshold: int

    @property
    def to_threshold(self) -> float:
        """The threshold in weight units: neurons rest at 0."""
        return self.threshold / WEIGHT_SCALE

    @property
    def keep(self) -> tuple[Floats, Floats]:
        """Factors of u and of v from one step to the next, float64: (4096 - d) / 4096, exact."""
        decays = (np.asarray(d, np.float64) for d in (self.decay_current, self.decay_voltage))
        keep_u, keep_v = ((DECAY_SCALE - d) / DECAY_SCALE for d in decays)
        return keep_u, keep_v

    def initial_state(self, shape: tuple[int, ...], calculus: Calculus) -> State:
        """Return the resting state: zeros."""
        return State(calculus.zeros(shape), calculus.zeros(shape))

    def step(self, state: State, drive: Array, calculus: Calculus) -> Step[State]:
        """Advance by one time step (equations in the module's docstring)."""
        xp, integer = calculus.xp, calculus.arithmetic == "integer"
        z = calculus.truncated(drive * STATE_SCALE) if integer else drive
        u, v = integrate(state, z, self.decay_current, self.decay_voltage, calculus)
        potential = v / STATE_SCALE if integer else v
        spikes = calculus.fire(potential, self.to_threshold)
        reset = calculus.constant(xp.where(spikes > 0, v, xp.zeros_like(v)))
        return Step(State(u, v - reset), potential, spikes)


def integrate(state: State, z: Array, decay_current: Ints, decay_voltage: Ints, calculus: Calculus) -> State:
    """Return u and v before reset one step on, given the input in the states' units."""
    u = leak(state.u, decay_current, calculus) + z
    return State(u, leak(state.v, decay_voltage, calculus) + u)


def leak(x: Array, decay: Ints, calculus: Calculus) -> Array:
    """Return x after one step of leak; integer states truncate toward zero."""
    if calculus.arithmetic == "integer":
        return calculus.truncated(x * (DECAY_SCALE - decay), DECAY_SCALE)
    leaked: Array = x * ((DECAY_SCALE - decay) / DECAY_SCALE)
    return leaked


@register("neurons", "cuba_lif")
@dataclass(frozen=True)
class CubaLif(Neuron):
    """Current-based leaky integrate-and-fire, as on Loihi (equations: dse.engine.neurons.cuba_lif)."""

    Populations: ClassVar[type[Any]] = Population
    label = "current-based leaky integrate-and-fire"
    arithmetics = ("integer", "float32", "ideal")
    exports = ("fixed_point",)
    units = MappingProxyType({"decay_current": "1/4096", "decay_voltage": "1/4096", "threshold": "1/64"})
    limits = MappingProxyType(
        {"decay_current": (0, DECAY_SCALE), "decay_voltage": (0, DECAY_SCALE), "threshold": (1, 2**31)}
    )
    on_chips = True
    state_updates = 2

    threshold: float = param(
        1.25, low=1 / 64, unit="weight", doc="firing threshold; weights are limited to -4 to 3.97"
    )
    current_decay: tuple[float, ...] = param(
        (0.25,),
        low=0,
        high=1,
        doc="current decay per input step; one value, or two bounds between which neurons differ",
    )
    voltage_decay: tuple[float, ...] = param(
        (0.03,),
        low=0,
        high=1,
        doc="voltage decay per input step; one value, or two bounds between which neurons differ",
    )
    output_current_decay: float = param(0.25, low=0, high=1, doc="current decay of output neurons")
    output_voltage_decay: float = param(0.03, low=0, high=1, doc="voltage decay of output neurons")

    def __post_init__(self) -> None:
        """Check what one key alone cannot say."""
        for name, bounds in (("current_decay", self.current_decay), ("voltage_decay", self.voltage_decay)):
            if not 1 <= len(bounds) <= 2:
                raise ValueError(f"{name} must be one decay or two bounds, got {len(bounds)} numbers")

    def population(self, layer: LayerSpec, rng: np.random.Generator) -> Population:
        """Return a layer's neurons; decays per input step are spread over its network steps."""
        current = (self.output_current_decay,) if layer.is_output else self.current_decay
        voltage = (self.output_voltage_decay,) if layer.is_output else self.voltage_decay
        return Population(
            decay_current=_decays(current, layer, rng),
            decay_voltage=_decays(voltage, layer, rng),
            threshold=round_threshold(self.threshold),
        )


def _decays(bounds: tuple[float, ...], layer: LayerSpec, rng: np.random.Generator) -> Ints:
    """Return integer decays per network step; two bounds spread the time constants log-uniformly."""
    keep = 1 - np.asarray(bounds, np.float64)
    if len(bounds) == 1 or bounds[0] == bounds[1]:
        spread = np.full(layer.n_neurons, keep[0])
    else:
        tau = -1 / np.log(np.clip(keep, 1e-9, 1 - 1e-6))
        shortest, longest = np.log(np.sort(tau))
        spread = np.exp(-1 / np.exp(rng.uniform(shortest, longest, layer.n_neurons)))
    return round_decay(1 - spread ** (1 / layer.steps_per_sample))


def rounded(current_decay: float, voltage_decay: float, threshold: float) -> Population:
    """Return neurons with real parameters rounded to the grid: decays half to even, threshold down.

    Raises:
        ValueError: a decay lies outside [0, 1], or the threshold rounds to less than 1/64.
    """
    for name, decay in (("current_decay", current_decay), ("voltage_decay", voltage_decay)):
        if not 0 <= decay <= 1:
            raise ValueError(f"{name} must be within [0, 1], got {decay}")
    return Population(round_decay(current_decay), round_decay(voltage_decay), round_threshold(threshold))


def round_decay(decay: Array | float) -> Ints:
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


def run(z: Floats, population: Population, arithmetic: Arithmetic) -> tuple[Floats, Floats, Bools]:
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
