"""Where training begins: time constants and weights of a stack that is neither silent nor saturated."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dse.engine import layers as engine
from dse.engine.events import Rows, delayed
from dse.neurons import cuba_lif
from dse.records import Array, Layer

if TYPE_CHECKING:
    from dse.models.snn.family import SNN

_GAIN_RANGE = 16.0


@dataclass(frozen=True)
class Population:
    """Fixed parameters of a layer.

    decay_current, decay_voltage: (neuron,) int32 decays per network step.
    threshold: integer mantissa.
    norm: (neuron,) root of the summed squared potential after one unit input spike.
    """

    decay_current: Array
    decay_voltage: Array
    threshold: int
    norm: Array


def _decays(bounds: tuple[float, ...], n: int, steps_per_sample: int, rng: np.random.Generator) -> Array:
    """Return integer decays per network step; two bounds spread the time constants log-uniformly."""
    keep = 1 - np.asarray(bounds, np.float64)
    if len(bounds) == 1 or bounds[0] == bounds[1]:
        kept = np.full(n, keep[0])
    else:
        tau = -1 / np.log(np.clip(keep, 1e-9, 1 - 1e-6))
        shortest, longest = np.log(np.sort(tau))
        kept = np.exp(-1 / np.exp(rng.uniform(shortest, longest, n)))
    return cuba_lif.round_decay(1 - kept ** (1 / steps_per_sample))


def _response_norm(decay_current: Array, decay_voltage: Array, n_steps: int) -> Array:
    """Return the root of the summed squared potential after one unit input spike, (neuron,)."""
    keep_u, keep_v = 1 - decay_current / 4096, 1 - decay_voltage / 4096
    u, v, total = np.ones(len(keep_u)), np.zeros(len(keep_u)), np.zeros(len(keep_u))
    for _ in range(n_steps):
        v = keep_v * v + u
        u = keep_u * u
        total += v**2
    return np.asarray(np.sqrt(total))


def populations_of(model: SNN, n_outputs: int, n_steps: int, rng: np.random.Generator) -> list[Population]:
    """Return the layers' fixed parameters, input side first.

    Args:
        model: settings; decays are per input step and are spread over its network steps here.
        n_outputs: output neurons.
        n_steps: network steps of a window.
        rng: draws the time constants.
    """
    found = []
    for depth, n in enumerate((*model.hidden, n_outputs)):
        is_output = depth == len(model.hidden)
        current = (model.output_current_decay,) if is_output else model.current_decay
        voltage = (model.output_voltage_decay,) if is_output else model.voltage_decay
        u = _decays(current, n, model.steps_per_sample, rng)
        v = _decays(voltage, n, model.steps_per_sample, rng)
        threshold = cuba_lif.round_threshold(model.threshold)
        found.append(Population(u, v, threshold, _response_norm(u, v, n_steps)))
    return found


def deployed(
    feed_forward: Sequence[Array],
    recurrent: Sequence[Array | None],
    populations: Sequence[Population | Layer],
    arithmetic: str,
) -> list[engine.Weights]:
    """Return float master weights, (input, neuron), as they run: rounded to 8 bits in integer arithmetic."""
    rounding = cuba_lif.quantise if arithmetic == "integer" else np.asarray
    return [
        engine.weights(
            rounding(w), None if r is None else rounding(r), p.decay_current, p.decay_voltage, p.threshold
        )
        for w, r, p in zip(feed_forward, recurrent, populations, strict=True)
    ]


def _reach_rate(rate: Callable[[float], float], wanted: float, start: float) -> tuple[float, float]:
    """Return the gain, and its rate, that comes closest to a wanted spike rate from below.

    The gain doubles from start / 16 until the rate is reached and the last step is then halved, so that
    the smallest gain is found where several reach it. It ends at 16 * start at the latest: a rate that
    cannot be reached leaves the closest gain that was met, never a runaway.
    """
    tried: list[tuple[float, float, float]] = []

    def measure(gain: float) -> float:
        found = rate(gain)
        tried.append((abs(found - wanted), gain, found))
        return found

    low = high = start / _GAIN_RANGE
    while measure(high) < wanted and high < start * _GAIN_RANGE:
        low, high = high, 2 * high
    for _ in range(6):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if measure(middle) < wanted else (low, middle)
    _, gain, reached = min(tried)
    return gain, reached


@dataclass(frozen=True)
class Start:
    """Master weights, (input, neuron), and per layer the spike rate that was wanted and the one reached."""

    feed_forward: list[Array]
    recurrent: list[Array | None]
    rates: list[tuple[float, float]]


def initialise(
    rows: Rows, model: SNN, populations: Sequence[Population], rng: np.random.Generator, n_heads: int = 1
) -> Start:
    """Draw weights and scale each layer, as deployed, until it fires at a given rate on a probe batch.

    Uniform weights are divided by each neuron's response to a unit spike, so that fast and slow neurons
    are driven alike. A hidden layer's gain is searched for the initial rate, which carries it over the
    8-bit rounding that would silence a layer of many inputs. An output neuron starts with weights that
    cancel over the mean input, plus a common share that is searched for the mean of its targets: outputs
    that start elsewhere are pushed as one into a silence that the loss does not leave.

    Args:
        rows: probe batch of input spikes.
        model: settings.
        populations: from `populations_of`.
        rng: draws the weights.
        n_heads: of the output, each with one neuron that is to fire.
    """
    feed_forward: list[Array] = []
    recurrent: list[Array | None] = []
    rates = []
    for depth, population in enumerate(populations):
        n = len(population.norm)
        cells = max(1, rows.n_samples * rows.n_steps)
        unit = population.threshold / cuba_lif.WEIGHT_SCALE / population.norm
        spread = math.sqrt(3 / max(1.0, rows.index.size / cells))
        drawn = rng.uniform(-1, 1, (rows.n_inputs, n)) * unit
        fixed: Array | float = 0.0
        ring = None
        wanted = model.initial_rate
        if depth == len(model.hidden):
            share = np.bincount(rows.index, minlength=rows.n_inputs) / max(1, rows.index.size)
            fixed = spread * (drawn - share @ drawn)
            drawn = np.broadcast_to(unit, drawn.shape)
            wanted = (n_heads * model.true_rate + (n - n_heads) * model.false_rate) / n
        elif model.recurrent:
            drive = math.sqrt(3 / max(1.0, model.initial_rate * n))
            ring = (rng.uniform(-0.5, 0.5, (n, n)) * unit * drive).astype(np.float32)

        def layer(
            gain: float,
            drawn: Array = drawn,
            fixed: Array | float = fixed,
            ring: Array | None = ring,
            population: Population = population,
        ) -> engine.Weights:
            return deployed(
                [(gain * drawn + fixed).astype(np.float32)], [ring], [population], model.arithmetic
            )[0]

        def rate(gain: float, rows: Rows = rows, layer: Callable[[float], engine.Weights] = layer) -> float:
            weights = layer(gain)
            fired = engine.forward(rows, weights, model.arithmetic).fired
            return fired.index.size / max(1, rows.n_samples * rows.n_steps * weights.n_neurons)

        gain, reached = _reach_rate(rate, wanted, spread)
        feed_forward.append((gain * drawn + fixed).astype(np.float32))
        recurrent.append(ring)
        rates.append((wanted, reached))
        rows = delayed(engine.forward(rows, layer(gain), model.arithmetic).fired)
    return Start(feed_forward, recurrent, rates)
