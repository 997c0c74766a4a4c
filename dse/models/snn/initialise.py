"""Where training begins: neurons and weights of a stack that is neither silent nor saturated."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dse.base.records import Arithmetic, Array, Floats, Ints, sum_of_products
from dse.engine import layers
from dse.engine.delays import running
from dse.engine.events import Rows, delayed
from dse.engine.forward import Forward, prepare
from dse.engine.neurons import LayerSpec, Population, tiled
from dse.engine.neurons.fixed_point import quantise, within_range
from dse.engine.neurons.response import response_norm
from dse.engine.shared import copies_of, expanded
from dse.models.snn.contrasts import Choice, Drives, first_layer
from dse.models.snn.quantise import finer
from dse.models.snn.settings import Stack

_GAIN_RANGE = 16.0
_BURSTS = 3.0  # of how much mean potentials are exceeded by bursts


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
        population = tiled(model.neuron.population(spec, rng), copies)
        populations.append(finer(population, model.exponent(depth)))
    return populations


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
    """Return how many spikes reach a neuron, in the mean over neurons; n equal ones at a time count n**2."""
    if shared is None:
        return float((rows.times.astype(np.float64) ** 2).sum()) if rows.times.size else rows.index.size
    reached = np.count_nonzero(shared >= 0, axis=1) / shared.shape[1]
    return float(reached[rows.index].sum())


@dataclass(frozen=True)
class Start:
    """Master weights, (input, neuron), and per layer the target spike rate and the one reached.

    delays: master delays, (input, neuron) float32; None where synapses have none.
    populations: the layers' neurons.
    chosen: which candidates a first layer is made of, as stored; None: another start.
    """

    feed_forward: list[Floats]
    recurrent: list[Floats | None]
    rates: list[tuple[float, float]]
    delays: list[Floats | None]
    populations: list[Population[Any]]
    chosen: Floats | None = None


def initialise(
    rows: Rows,
    model: Stack,
    populations: Sequence[Population[Any]],
    n_outputs: int,
    rng: np.random.Generator,
    n_heads: int = 1,
    of_delays: np.random.Generator | None = None,
    choice: Choice | None = None,
) -> Start:
    """Draw weights and scale each layer, as deployed, until it fires at a given rate on a probe batch.

    Uniform weights are divided by each neuron's response to a unit spike, so that fast and slow neurons
    are driven alike. A hidden layer's gain is searched for the initial rate, which carries it over the
    8-bit rounding that would silence a layer of many inputs. An output neuron starts with weights that
    cancel over the mean input, plus a common share that is searched for the mean of its targets: outputs
    that start elsewhere are pushed as one into a silence that the loss does not leave. The first layer of
    contrasts or kernels is chosen from candidates (dse.models.snn.contrasts), and all layers of a start by
    fan_in are as drawn, whatever their rates.

    Args:
        rows: probe batch of input spikes.
        model: settings.
        populations: from `populations_of`.
        n_outputs: output neurons.
        rng: draws the weights.
        n_heads: of the output, each with one neuron that is to fire.
        of_delays: draws delays, of synapses uniform in [0, model.max_delay], of axons in [0, 1); None: there
            are none.
        choice: of a first layer from candidates; None: it is drawn.
    """
    populations, picked = list(populations), None
    feed_forward: list[Floats] = []
    recurrent: list[Floats | None] = []
    delays: list[Floats | None] = []
    rates = []
    sharing = model.sharing(n_outputs)
    within = within_range if model.arithmetic == "integer" else np.asarray
    for depth, n in enumerate((*model.hidden, n_outputs)):
        kind = model.candidates if depth == 0 else None
        is_chosen = choice is not None and kind is not None
        if choice is not None and kind is not None:
            drives = Drives(rows, populations[0], n, model.most_peak / _BURSTS, choice.wiring)
            first, populations[0], picked = first_layer(kind, drives, n, rng, choice)
        population = populations[depth]
        cells = max(1, rows.n_samples * rows.n_steps)
        unit = population.to_threshold / response_norm(population, n, rows.n_steps)
        shared = sharing[depth]
        spread = math.sqrt(3 / max(1.0, _arriving(rows, shared) / cells))
        is_fan_in = model.start == "fan_in"
        scale = model.weight_scale / math.sqrt(rows.n_inputs) if is_fan_in else unit
        if shared is None:
            drawn = rng.uniform(-1, 1, (rows.n_inputs, n)) * scale
        else:
            drawn = expanded(rng.uniform(-1, 1, copies_of(shared).n_weights), shared) * scale
        fixed: Floats | float = 0.0
        ring = None
        target = model.initial_rate
        as_drawn = is_chosen or is_fan_in
        if is_chosen:
            drawn = first
        if depth == len(model.hidden) and not is_fan_in:
            share = np.bincount(rows.index, minlength=rows.n_inputs) / max(1, rows.index.size)
            fixed = spread * (drawn - sum_of_products(drawn.T, share))
            drawn = np.broadcast_to(unit, drawn.shape)
            target = (n_heads * model.true_rate + (n - n_heads) * model.false_rate) / n
        elif model.recurrent and depth < len(model.hidden):
            drive = math.sqrt(3 / max(1.0, model.initial_rate * n))
            own, drive = (2 * model.weight_scale, n**-0.5) if is_fan_in else (unit, drive)
            ring = (rng.uniform(-0.5, 0.5, (n, n)) * own * drive).astype(np.float32)

        late = None
        if of_delays is not None and model.has_delays(depth):
            axonal = model.max_axonal_delay > 0
            shape = (rows.n_inputs, 1) if axonal else drawn.shape
            late = of_delays.uniform(0, model.max_delay or 1, shape).astype(np.float32)
            late = np.broadcast_to(late, drawn.shape)

        def forward(
            gain: float,
            rows: Rows = rows,
            drawn: Floats = drawn,
            fixed: Floats | float = fixed,
            ring: Floats | None = ring,
            population: Population[Any] = population,
            delay: Floats | None = late,
            is_dithered: bool = model.is_dithered(depth),
        ) -> Forward:
            matrix = (gain * drawn + fixed).astype(np.float32)
            rounded = None if delay is None else running(delay, model.max_axonal_delay > 0)
            if is_dithered:
                return prepare(layers.weights(matrix, ring, population), model.arithmetic).forward(rows)
            (weights,) = deployed([matrix], [ring], [population], model.arithmetic, [rounded])
            return prepare(weights, model.arithmetic).forward(rows)

        def rate(gain: float, forward: Callable[[float], Forward] = forward) -> float:
            fired = forward(gain).fired
            return fired.index.size / max(1, fired.n_samples * fired.n_steps * fired.n_inputs)

        gain, reached = (1.0, rate(1.0)) if as_drawn else reach_rate(rate, target, spread)
        master = (gain * drawn + fixed).astype(np.float32)
        feed_forward.append(master if model.is_dithered(depth) else within(master))
        recurrent.append(None if ring is None else within(ring))
        delays.append(late)
        rates.append((reached if as_drawn else target, reached))
        rows = delayed(forward(gain).fired)
    return Start(feed_forward, recurrent, rates, delays, populations, picked)
