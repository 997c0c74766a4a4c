"""Integrate-and-fire neurons that decay by bit shifts, bit for bit as on SynSense Xylo.

States are signed 16-bit integers that saturate; sat(x) is the nearest of them. A weight is 8 bits,
shifted left by the layer's `weight_shift`. With D(x, k) = x - (x >> k), but at least 1 nearer to 0 unless
x = 0, where >> rounds down, at step t:

    i[t] = D(sat(i[t-1] + z[t]), k_i)          current; z = weighted input spikes, which decay at once
    v[t] = sat(v_r[t-1] + sat(i[t] - (v_r[t-1] - D(v_r[t-1], k_v))))
    s[t] = floor(v[t] / threshold)             spikes: as often as v[t] reaches it, at most `most_spikes`
    v_r[t] = v[t] - s[t] threshold             reset by subtraction; i is not reset

A hidden neuron spikes up to 31 times in a step, an output once: what it has left spikes in the next steps. A
layer hands its spikes on one step later. What the shifts round to:
- x > 0 loses floor(x / 2**k), but 1 at least; x < 0 loses ceil(|x| / 2**k). So every state reaches 0.
- k_i = 0 would silence a neuron: its current is gone before it is added. So k_i is 1 at least.
- k_v = 0 means a potential without memory.

The chip saturates i after every single spike, this definition after their sum. So that it matters nowhere,
states have room for 32 thresholds and more: `weight_shift` is the largest that leaves the threshold at most
2**10. Real arithmetic neither rounds nor loses the least step, but saturates.

Backward in time reset and saturation are ignored, rounding passes straight through, and of the spikes of a
step the first has the surrogate for its derivative.

Source: SynSense's simulator xylosim 0.1.3, module v2, which `tests/golden/xylo.json` is a record of
(REFERENCES.md).
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple

import numpy as np

from dse.base.records import Array, Ints
from dse.base.registry import param, register
from dse.engine.neurons import LayerSpec, Neuron, Step
from dse.engine.neurons.calculus import Calculus

STATE_BITS = 16
WEIGHT_STEPS = 32
"""8-bit steps in a weight of 1 (dse.engine.neurons.fixed_point)."""
MOST_SPIKES = 31
"""Of a hidden neuron in a step."""

LOWEST, HIGHEST = -(2 ** (STATE_BITS - 1)), 2 ** (STATE_BITS - 1) - 1
_MOST_THRESHOLD = 2**10
_MOST_WEIGHT_SHIFT = STATE_BITS - 8  # a shifted weight is a 16-bit number


class State(NamedTuple):
    """Current i and potential after reset v, (..., neuron): 16-bit integers, or in weight units."""

    i: Array
    v: Array


@dataclass(frozen=True)
class Population:
    """Neurons of a layer.

    current_shift, voltage_shift: k_i and k_v, (neuron,).
    threshold: of the integer potential.
    weight_shift: bits by which weights are shifted left.
    most_spikes: of a neuron in a step.
    """

    current_shift: Ints
    voltage_shift: Ints
    threshold: int
    weight_shift: int
    most_spikes: int

    @property
    def per_weight(self) -> int:
        """Integer units of a weight of 1."""
        return WEIGHT_STEPS << self.weight_shift

    @property
    def to_threshold(self) -> float:
        """The threshold in weight units: neurons rest at 0."""
        return self.threshold / self.per_weight

    def initial_state(self, shape: tuple[int, ...], calculus: Calculus) -> State:
        """Return the resting state: zeros."""
        return State(calculus.zeros(shape), calculus.zeros(shape))

    def step(self, state: State, drive: Array, calculus: Calculus) -> Step[State]:
        """Advance by one time step (equations in the module's docstring)."""
        integer = calculus.arithmetic == "integer"
        z = calculus.truncated(drive * self.per_weight) if integer else drive
        ends = (LOWEST, HIGHEST) if integer else (LOWEST / self.per_weight, HIGHEST / self.per_weight)

        def saturated(x: Array) -> Array:
            return x + calculus.constant(calculus.xp.clip(x, *ends) - x)

        i = _decayed(saturated(state.i + z), self.current_shift, calculus)
        lost = state.v - _decayed(state.v, self.voltage_shift, calculus)
        v = saturated(state.v + saturated(i - lost))
        potential = v / self.per_weight if integer else v
        # Half a unit below an integer threshold, equality fires.
        first = calculus.fire(potential, (self.threshold - 0.5) / self.per_weight)
        whole = calculus.truncated(calculus.constant(potential) / self.to_threshold)
        spikes = first + calculus.xp.clip(whole - 1, 0, self.most_spikes - 1)
        reset = calculus.constant(spikes * (self.threshold if integer else self.to_threshold))
        return Step(State(i, v - (calculus.truncated(reset) if integer else reset)), potential, spikes)


def _decayed(x: Array, shift: Ints, calculus: Calculus) -> Array:
    """Return D(x, shift)."""
    unit = 2**shift
    if calculus.arithmetic != "integer":
        return x - x / unit
    xp = calculus.xp
    lost = calculus.truncated(x - xp.where(x < 0, unit - 1, 0 * unit), unit)
    return x - lost - calculus.constant(xp.where((x > 0) & (lost == 0), xp.ones_like(x), xp.zeros_like(x)))


@register("neurons", "xylo_lif")
@dataclass(frozen=True)
class XyloLif(Neuron):
    """Integrate-and-fire as on SynSense Xylo: decays by shifts (equations: dse.engine.neurons.xylo_lif)."""

    Populations: ClassVar[type[Any]] = Population
    label = "bit-shift integrate-and-fire"
    arithmetics = ("integer", "float32", "ideal")
    exports = ("fixed_point",)
    units = MappingProxyType({"threshold": "1/2**(5 + weight_shift)"})
    limits = MappingProxyType(
        {
            "current_shift": (1, 15),
            "voltage_shift": (0, 15),
            "threshold": (1, HIGHEST),
            "weight_shift": (0, _MOST_WEIGHT_SHIFT),
            "most_spikes": (1, MOST_SPIKES),
        }
    )
    on_chips = True
    state_updates = 2
    most_spikes = MOST_SPIKES

    threshold: float = param(
        4.0,
        low=1 / 8,
        high=32,
        unit="weight",
        doc="firing threshold; weights are limited to -4 to 3.97",
    )
    current_shift: tuple[int, ...] = param(
        (1, 2),
        low=1,
        high=15,
        doc="bits by which currents shift to decay: 2**shift network steps are their time constant; one "
        "value, or two bounds between which neurons differ",
    )
    voltage_shift: tuple[int, ...] = param(
        (1, 3),
        low=0,
        high=15,
        doc="bits by which potentials shift to decay: 2**shift network steps are their time constant; one "
        "value, or two bounds between which neurons differ",
    )
    output_current_shift: int = param(3, low=1, high=15, doc="current_shift of output neurons")
    output_voltage_shift: int = param(5, low=0, high=15, doc="voltage_shift of output neurons")

    def __post_init__(self) -> None:
        """Check what one key alone cannot say."""
        for name, bounds in (("current_shift", self.current_shift), ("voltage_shift", self.voltage_shift)):
            if not 1 <= len(bounds) <= 2:
                raise ValueError(f"{name} must be one shift or two bounds, got {len(bounds)} numbers")
            if bounds[0] > bounds[-1]:
                raise ValueError(f"{name} must have bounds in increasing order, got {list(bounds)}")

    def population(self, layer: LayerSpec, rng: np.random.Generator) -> Population:
        """Return a layer's neurons."""
        current = (self.output_current_shift,) if layer.is_output else self.current_shift
        voltage = (self.output_voltage_shift,) if layer.is_output else self.voltage_shift
        steps = self.threshold * WEIGHT_STEPS
        shift = max(s for s in range(_MOST_WEIGHT_SHIFT + 1) if steps * 2**s <= _MOST_THRESHOLD)
        return Population(
            current_shift=_drawn(current, layer.n_neurons, rng),
            voltage_shift=_drawn(voltage, layer.n_neurons, rng),
            threshold=int(steps * 2**shift),
            weight_shift=shift,
            most_spikes=1 if layer.is_output else MOST_SPIKES,
        )


def _drawn(bounds: tuple[int, ...], n: int, rng: np.random.Generator) -> Ints:
    """Return one shift per neuron, each between the bounds equally likely."""
    if bounds[0] == bounds[-1]:
        return np.full(n, bounds[0], np.int32)
    return rng.integers(bounds[0], bounds[-1], n, np.int32, endpoint=True)
