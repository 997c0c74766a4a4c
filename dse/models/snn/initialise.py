"""Where training begins: neurons and weights of a stack that is neither silent nor saturated."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dse.engine import layers
from dse.engine.events import Rows, delayed
from dse.engine.forward import Forward, prepare
from dse.engine.shared import copies_of, expanded
from dse.models.snn.settings import Stack
from dse.neurons import LayerSpec, Population, tiled
from dse.neurons.calculus import NumpyCalculus
from dse.neurons.fixed_point import quantise, within_range
from dse.records import Arithmetic, Array, Floats, Ints, sum_of_products

_GAIN_RANGE = 16.0
_IMPULSE = 2.0**-30  # a power of two scales float64 exactly, and so small a drive makes nothing fire


def populations_of(
    model: Stack, n_outputs: int, step_ms: float, rng: np.random.Generator
) -> list[Population[Any]]:
    """Return the layers' neurons, input side first.

    Args:
        model: settings.
        n_outputs: output neurons.
        step_ms: duration of an input step.
        rng: draws what differs between neurons.
    """
    populations = []
    for depth, n in enumerate((*model.hidden, n_outputs)):
        copies = 1 if depth else model.copies
        spec = LayerSpec(
            n_neurons=n // copies,
            is_output=depth == len(model.hidden),
            steps_per_sample=model.steps_per_sample,
            step_ms=step_ms / model.steps_per_sample,
        )
        populations.append(tiled(model.neuron.population(spec, rng), copies))
    return populations


def response_norm(population: Population[Any], n_neurons: int, n_steps: int) -> Floats:
    """Return the root of the summed squared potential after one unit input spike, (neuron,).

    The response is that to an impulse so small that no neuron fires, against the potential without any.
    """
    calculus = NumpyCalculus("ideal")
    state = population.initial_state((2, n_neurons), calculus)
    drive, total = np.zeros((2, n_neurons)), np.zeros(n_neurons)
    drive[1] = _IMPULSE
    for _ in range(n_steps):
        state, potential, _ = population.step(state, drive, calculus)
        total += ((potential[1] - potential[0]) / _IMPULSE) ** 2
        drive = np.zeros_like(drive)
    return np.asarray(np.sqrt(total))


def deployed(
    feed_forward: Sequence[Floats],
    recurrent: Sequence[Floats | None],
    populations: Sequence[Population[Any]],
    arithmetic: Arithmetic,
    delays: Sequence[Array | None] | None = None,
) -> list[layers.Weights]:
    """Return float master weights, (input, neuron), as they run: rounded to 8 bits in integer arithmetic.

    `delays` are those of the synapses, (input, neuron), None where a layer has none; None: no layer has.
    """
    rounding = quantise if arithmetic == "integer" else np.asarray
    late = [None] * len(feed_forward) if delays is None else delays
    return [
        layers.weights(rounding(w), None if r is None else rounding(r), population, d)
        for w, r, population, d in zip(feed_forward, recurrent, populations, late, strict=True)
    ]


def reach_rate(rate: Callable[[float], float], target: float, start: float) -> tuple[float, float]:
    """Return the gain, and its rate, that comes closest to a target spike rate from below.

    The gain doubles from start / 16 until the rate is reached and the last step is then halved, so that
    the smallest gain is found where several reach it. It ends at 16 * start at the latest: a rate that
    cannot be reached leaves the closest gain that was met, never a runaway.
    """
    tried: list[tuple[float, float, float]] = []

    def measure(gain: float) -> float:
        reached = rate(gain)
        tried.append((abs(reached - target), gain, reached))
        return reached

    low = high = start / _GAIN_RANGE
    while measure(high) < target and high < start * _GAIN_RANGE:
        low, high = high, 2 * high
    for _ in range(6):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if measure(middle) < target else (low, middle)
    _, gain, reached = min(tried)
    return gain, reached


def _arriving(rows: Rows, shared: Ints | None) -> float:
    """Return how many spikes reach a neuron, in the mean over neurons."""
    if shared is None:
        return rows.index.size
    reached = np.count_nonzero(shared >= 0, axis=1) / shared.shape[1]
    return float(reached[rows.index].sum())


@dataclass(frozen=True)
class Start:
    """Master weights, (input, neuron), and per layer the target spike rate and the one reached.

    delays: master delays, (input, neuron) float32; None where synapses have none.
    """

    feed_forward: list[Floats]
    recurrent: list[Floats | None]
    rates: list[tuple[float, float]]
    delays: list[Floats | None]


def initialise(
    rows: Rows,
    model: Stack,
    populations: Sequence[Population[Any]],
    n_outputs: int,
    rng: np.random.Generator,
    n_heads: int = 1,
    of_delays: np.random.Generator | None = None,
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
        n_outputs: output neurons.
        rng: draws the weights.
        n_heads: of the output, each with one neuron that is to fire.
        of_delays: draws delays, uniform in [0, model.max_delay]; None: no synapse has one.
    """
    feed_forward: list[Floats] = []
    recurrent: list[Floats | None] = []
    delays: list[Floats | None] = []
    rates = []
    sharing = model.sharing(n_outputs)
    within = within_range if model.arithmetic == "integer" else np.asarray
    for depth, (n, population) in enumerate(zip((*model.hidden, n_outputs), populations, strict=True)):
        cells = max(1, rows.n_samples * rows.n_steps)
        unit = population.to_threshold / response_norm(population, n, rows.n_steps)
        shared = sharing[depth]
        spread = math.sqrt(3 / max(1.0, _arriving(rows, shared) / cells))
        if shared is None:
            drawn = rng.uniform(-1, 1, (rows.n_inputs, n)) * unit
        else:
            drawn = expanded(rng.uniform(-1, 1, copies_of(shared).n_weights), shared) * unit
        fixed: Floats | float = 0.0
        ring = None
        target = model.initial_rate
        if depth == len(model.hidden):
            share = np.bincount(rows.index, minlength=rows.n_inputs) / max(1, rows.index.size)
            fixed = spread * (drawn - sum_of_products(drawn.T, share))
            drawn = np.broadcast_to(unit, drawn.shape)
            target = (n_heads * model.true_rate + (n - n_heads) * model.false_rate) / n
        elif model.recurrent:
            drive = math.sqrt(3 / max(1.0, model.initial_rate * n))
            ring = (rng.uniform(-0.5, 0.5, (n, n)) * unit * drive).astype(np.float32)

        late = None
        if of_delays is not None and model.has_delays(depth):
            late = of_delays.uniform(0, model.max_delay, drawn.shape).astype(np.float32)

        def forward(
            gain: float,
            rows: Rows = rows,
            drawn: Floats = drawn,
            fixed: Floats | float = fixed,
            ring: Floats | None = ring,
            population: Population[Any] = population,
            delay: Floats | None = late,
        ) -> Forward:
            matrix = (gain * drawn + fixed).astype(np.float32)
            rounded = None if delay is None else np.rint(delay)
            (weights,) = deployed([matrix], [ring], [population], model.arithmetic, [rounded])
            return prepare(weights, model.arithmetic).forward(rows)

        def rate(gain: float, forward: Callable[[float], Forward] = forward) -> float:
            fired = forward(gain).fired
            return fired.index.size / max(1, fired.n_samples * fired.n_steps * fired.n_inputs)

        gain, reached = reach_rate(rate, target, spread)
        feed_forward.append(within((gain * drawn + fixed).astype(np.float32)))
        recurrent.append(None if ring is None else within(ring))
        delays.append(late)
        rates.append((target, reached))
        rows = delayed(forward(gain).fired)
    return Start(feed_forward, recurrent, rates, delays)
