"""Resonators: damped rotations of two states, which answer to spikes that come at their own period.

With trunc = toward zero, 12-bit factors c = round(4096 r cos w) and s = round(4096 r sin w) per neuron, and
weights on a grid of 1/64, at step t:

    x[t] = trunc((c x[t-1] - s y[t-1]) / 4096) + z[t]      z = weighted input spikes
    y[t] = trunc((s x[t-1] + c y[t-1]) / 4096)             membrane potential
    s[t] = 1 if y[t] > threshold else 0                    strictly above: equality does not fire

Nothing is reset; with `reset`, y := 0 after a spike, and x goes on. A neuron of period P steps and quality
factor q has

    w = 2 pi / P,    r = exp(-1 / tau),    tau = q P / pi, no less than 1 and no more than 4096 steps

so that its amplitude falls by e in q / pi periods; s is 1 at least, so that every resonator answers. With
such tau, c^2 + s^2 < 4096^2 after rounding too, and truncation only takes away: without input every state
ends at exactly 0, and none grows beyond the summed input.

`integer` arithmetic holds x and y as integers in units of 1/4096: four multiplications per neuron and step,
where CUBA-LIF has two. Real arithmetic does not truncate. A layer hands its spikes on one step later.

The first neurons of a hidden layer resonate, as many as `share` says. The others, and the outputs, are
CUBA-LIF (dse.engine.neurons.cuba_lif), with u and v in the places of x and y.

Backward in time the reset is ignored and truncation passes straight through (`backward`).

Source: Izhikevich 2001; Orchard et al. 2021, resonators on Loihi 2 (REFERENCES.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from dse.base.records import Array, Bools, Floats, Ints
from dse.base.registry import param, register
from dse.engine.neurons import LayerSpec, Step, cuba_lif
from dse.engine.neurons.calculus import Calculus
from dse.engine.neurons.fixed_point import DECAY_SCALE, STATE_SCALE, WEIGHT_SCALE

_LEAST_TAU, _MOST_TAU = 1.0, 4096.0

PeriodUnit = Literal["steps", "ms", "Hz"]


class State(NamedTuple):
    """x and y after the step, resets included, (..., neuron); of CUBA-LIF neurons u and v."""

    x: Array
    y: Array


class Cross(NamedTuple):
    """What one state gives to the other, (neuron,) float64 each (dse.engine.kernels).

    y_to_x, x_to_y: of the step before. now_to_y: of x of the same step.
    hold: 0 where a spike resets y, else 1.
    """

    y_to_x: Floats
    x_to_y: Floats
    now_to_y: Floats
    hold: Floats


@dataclass(frozen=True)
class Population:
    """Neurons of a layer.

    resonates: (neuron,) whether it is a resonator; the others are CUBA-LIF.
    cosine, sine: (neuron,) int32 c and s of the resonators, in 1/4096; 0 of the others.
    decay_current, decay_voltage: (neuron,) int32 decays of the others in [0, 4096]; 0 of the resonators.
    threshold: integer mantissa; the real threshold is threshold / 64.
    reset: whether a spike resets y of a resonator.
    """

    resonates: Bools
    cosine: Ints
    sine: Ints
    decay_current: Ints
    decay_voltage: Ints
    threshold: int
    reset: bool

    @property
    def to_threshold(self) -> float:
        """The threshold in weight units: neurons rest at 0."""
        return self.threshold / WEIGHT_SCALE

    @property
    def keep(self) -> tuple[Floats, Floats]:
        """Factors of x and of y from one step to the next, float64, exact."""
        c = np.asarray(self.cosine, np.float64) / DECAY_SCALE
        lif = ((DECAY_SCALE - np.asarray(d, np.float64)) / DECAY_SCALE for d in self._decays)
        keep_x, keep_y = (np.where(self.resonates, c, keep) for keep in lif)
        return keep_x, keep_y

    @property
    def cross(self) -> Cross:
        """What one state gives to the other, exact."""
        s = np.where(self.resonates, np.asarray(self.sine, np.float64) / DECAY_SCALE, 0.0)
        lif = np.where(self.resonates, 0.0, 1.0)
        hold = np.where(self.resonates & (not self.reset), 1.0, 0.0)
        return Cross(-s, s, lif, hold)

    @property
    def _decays(self) -> tuple[Ints, Ints]:
        return self.decay_current, self.decay_voltage

    def initial_state(self, shape: tuple[int, ...], calculus: Calculus) -> State:
        """Return the resting state: zeros."""
        return State(calculus.zeros(shape), calculus.zeros(shape))

    def step(self, state: State, drive: Array, calculus: Calculus) -> Step[State]:
        """Advance by one time step (equations in the module's docstring)."""
        xp, integer = calculus.xp, calculus.arithmetic == "integer"
        z = calculus.truncated(drive * STATE_SCALE) if integer else drive
        rotated = rotate(state, self.cosine, self.sine, calculus)
        u, v = cuba_lif.integrate(cuba_lif.State(*state), z, *self._decays, calculus)
        x = xp.where(self.resonates, rotated.x + z, u)
        y = xp.where(self.resonates, rotated.y, v)
        potential = y / STATE_SCALE if integer else y
        spikes = calculus.fire(potential, self.to_threshold)
        resets = (spikes > 0) & (~self.resonates | self.reset)
        reset = calculus.constant(xp.where(resets, y, xp.zeros_like(y)))
        return Step(State(x, y - reset), potential, spikes)

    def awake(self, state: State) -> Bools:
        """Return which resonators must go on turning, wherever their potential is."""
        return np.asarray(self.resonates & (state.x != 0))


def rotate(state: State, cosine: Ints, sine: Ints, calculus: Calculus) -> State:
    """Return x and y after one step without input; integer states truncate toward zero."""
    x, y = state
    if calculus.arithmetic == "integer":
        return State(
            calculus.truncated(x * cosine - y * sine, DECAY_SCALE),
            calculus.truncated(x * sine + y * cosine, DECAY_SCALE),
        )
    c, s = cosine / DECAY_SCALE, sine / DECAY_SCALE
    return State(x * c - y * s, x * s + y * c)


@register("neurons", "resonator")
@dataclass(frozen=True)
class Resonator(cuba_lif.CubaLif):
    """Resonators; other neurons and the outputs are CUBA-LIF (equations: dse.engine.neurons.resonator)."""

    Populations = Population
    label = "resonating"
    units = MappingProxyType({**cuba_lif.CubaLif.units, "cosine": "1/4096", "sine": "1/4096"})
    limits = MappingProxyType(
        {**cuba_lif.CubaLif.limits, "cosine": (-DECAY_SCALE, DECAY_SCALE), "sine": (0, DECAY_SCALE)}
    )
    programmed: ClassVar[bool] = True

    share: float = param(
        1.0,
        low=0,
        low_open=True,
        high=1,
        doc="fraction of each hidden layer that resonates; others are CUBA-LIF",
    )
    period: tuple[float, ...] = param(
        (2.2, 40.0),
        low=0,
        low_open=True,
        doc="period of a resonator, in `period_unit`; one value, or two bounds between which neurons differ "
        "log-uniformly; at least 2 input steps",
    )
    period_unit: PeriodUnit = param(  # noqa: RUF009
        "steps",
        choices=("steps", "ms", "Hz"),
        doc="unit of `period`: input steps, ms, or Hz (frequencies)",
    )
    quality: tuple[float, ...] = param(
        (1.5, 5.0),
        low=0,
        low_open=True,
        doc="quality factor of a resonator: its amplitude falls by e in quality / pi periods; one value, or "
        "two bounds between which neurons differ uniformly",
    )
    reset: bool = param(False, doc="whether a spike sets the potential of a resonator to 0")

    def __post_init__(self) -> None:
        """Check what one key alone cannot say."""
        super().__post_init__()
        for name, bounds in (("period", self.period), ("quality", self.quality)):
            if not 1 <= len(bounds) <= 2:
                raise ValueError(f"{name} must be one number or two bounds, got {len(bounds)} numbers")
            if bounds[0] > bounds[-1]:
                raise ValueError(f"{name} must have bounds in increasing order, got {list(bounds)}")
        if self.period_unit == "steps":
            self._periods(1.0)

    def check_step(self, step_ms: float) -> None:
        """Check that every period has at least 2 input steps."""
        self._periods(step_ms)

    @classmethod
    def resonators(cls, parameters: Mapping[str, Array]) -> int:
        """Return how many neurons of a layer resonate."""
        return int(np.count_nonzero(parameters["resonates"]))

    def population(self, layer: LayerSpec, rng: np.random.Generator) -> Population | cuba_lif.Population:  # type: ignore[override]
        """Return a layer's neurons; an output layer is CUBA-LIF.

        Raises:
            ValueError: a period is below 2 input steps.
        """
        if layer.is_output:
            return super().population(layer, rng)
        n = layer.n_neurons
        n_resonators = max(1, round(self.share * n))
        low, high = np.log(self._periods(layer.step_ms * layer.steps_per_sample))
        period = layer.steps_per_sample * np.exp(rng.uniform(low, high, n_resonators))
        quality = rng.uniform(self.quality[0], self.quality[-1], n_resonators)
        others = super().population(LayerSpec(**{**vars(layer), "n_neurons": n - n_resonators}), rng)
        resonates = np.arange(n) < n_resonators
        c, s = factors(period, quality)

        def placed(of_resonators: Ints | int, of_others: Ints | int) -> Ints:
            out = np.zeros(n, np.int32)
            out[:n_resonators], out[n_resonators:] = of_resonators, of_others
            return out

        return Population(
            resonates=resonates,
            cosine=placed(c, 0),
            sine=placed(s, 0),
            decay_current=placed(0, others.decay_current),
            decay_voltage=placed(0, others.decay_voltage),
            threshold=others.threshold,
            reset=self.reset,
        )

    def _periods(self, step_ms: float) -> tuple[float, float]:
        """Return the shortest and the longest period in input steps."""
        step = {"steps": 1.0, "ms": 1 / step_ms, "Hz": 1e3 / step_ms}[self.period_unit]
        ends = [step / x if self.period_unit == "Hz" else step * x for x in self.period]
        shortest, longest = min(ends), max(ends)
        if not shortest >= 2:
            of = "" if self.period_unit == "steps" else f" of {step_ms:g} ms"
            end = self.period[-1 if self.period_unit == "Hz" else 0]
            unit = "" if self.period_unit == "steps" else f" {self.period_unit}"
            raise ValueError(f"period must be at least 2 input steps{of}, got {end:g}{unit}")
        return shortest, longest


def factors(period: Floats | float, quality: Floats | float) -> tuple[Ints, Ints]:
    """Return c and s in 1/4096 of resonators, given their periods in network steps and quality factors."""
    tau = np.clip(np.asarray(quality, np.float64) * period / np.pi, _LEAST_TAU, _MOST_TAU)
    r, w = np.exp(-1 / tau), 2 * np.pi / np.asarray(period, np.float64)
    c, s = (np.rint(DECAY_SCALE * r * part).astype(np.int32) for part in (np.cos(w), np.sin(w)))
    return c, np.maximum(s, 1)


def backward(grad_spikes: Floats, surrogate_gradient: Floats, population: Population) -> Floats:
    """Return dL/dz of a population: the transposed steps backward in time, the reset ignored.

        X[t] = c X[t+1] + s Y[t+1] = dL/dz[t];   Y[t] = -s X[t+1] + c Y[t+1] + dL/ds[t] * ds/dy[t]

    of a resonator; of the others as in dse.engine.neurons.cuba_lif. Truncation and rounding are
    straight-through. Arrays are (sample, step, neuron).
    """
    out = np.array(
        cuba_lif.backward(
            grad_spikes,
            surrogate_gradient,
            cuba_lif.Population(population.decay_current, population.decay_voltage, population.threshold),
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
