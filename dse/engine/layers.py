"""CUBA-LIF neurons and resonators on the CPU: sparse rows in, sparse rows out, gradients summed from events.

A batch goes through in chunks of samples, a layer in blocks of columns: a block's weights and one chunk's
states stay in the cache, and what is held grows with chunk x hidden neurons, never with inputs x time.
Integer states are held in float64, where they are exact up to 2**40 (products with a decay stay below 2**53).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from dse.base.native.compiled import compiled
from dse.base.records import Arithmetic, Array, Floats, Ints
from dse.engine import arrivals, delays, kernels
from dse.engine.batch import chunk_samples
from dse.engine.events import ONCE, Rows, pooled
from dse.engine.layout import LANES, aligned, packed, padded, unpacked, width_at
from dse.engine.neurons import Population, cuba_lif, resonator
from dse.engine.neurons.fixed_point import STATE_SCALE, WEIGHT_SCALE
from dse.engine.neurons.surrogate import Exponential

GRID = WEIGHT_SCALE / 2
"""8-bit weights are whole numbers on a grid of 1/32."""

_FEW_POOLS = 8
"""Inputs are counted by pools where there are so many times as many."""
_NONE = np.zeros((0, 0), np.float32)
_NO_UPDATES = np.zeros(0, np.int32)
NO_DELAY = np.zeros((0, 0), np.int8)
_NO_SURROGATE = (0.0, 0.0, 0.0, -math.inf)


@dataclass(frozen=True)
class Weights:
    """What the engine runs of a layer: weights by input (input, neuron), so that a spike reads one row.

    feed_forward: (input, neuron) float32.
    recurrent: (neuron, neuron) float32, row = presynaptic; (0, 0) where there is none.
    population: the neurons.
    delay: (input, neuron) int8 delays of the feed-forward synapses, 0 to 62 steps; (0, 0): none has any.
    axonal: whether these are the delays of the inputs' axons, and learnt as such (dse.engine.delays).
    """

    feed_forward: Floats
    recurrent: Floats
    population: Population[Any]
    delay: Array = field(default_factory=lambda: NO_DELAY)
    axonal: bool = False

    @property
    def n_neurons(self) -> int:
        return int(self.feed_forward.shape[1])


def weights(
    feed_forward: Floats,
    recurrent: Floats | None,
    population: Population[Any],
    delay: Array | None = None,
) -> Weights:
    """Return engine weights from (input, neuron) matrices and the layer's neurons."""
    return Weights(
        np.ascontiguousarray(feed_forward, np.float32),
        _NONE if recurrent is None else np.ascontiguousarray(recurrent, np.float32),
        population,
        NO_DELAY if delay is None else np.ascontiguousarray(delay, np.int8),
    )


def kernel_population(population: Population[Any]) -> cuba_lif.Population | resonator.Population:
    """Return a population that the kernels run, typed as such."""
    if not isinstance(population, cuba_lif.Population | resonator.Population):
        kind = f"{type(population).__module__}.{type(population).__qualname__}"
        raise TypeError(f"only CUBA-LIF neurons and resonators have a kernel, got {kind}")
    return population


def has_kernel(neurons: type[Any]) -> bool:
    """Return whether the kernels run populations of a class."""
    return issubclass(neurons, cuba_lif.Population | resonator.Population)


class KernelLayer(NamedTuple):
    """A layer as the kernels read it: matrices in blocks, neurons padded, all of one arithmetic.

    table, ring: int8 or floating weights; `ring` is empty where there is none.
    table_unit, ring_unit: weight units per unit of the matrix.
    keep_u, keep_v: factors in the states' precision; back_u, back_v: in the gradients'.
    cross, back_cross: (4 * n_columns,) neurons.resonator.Cross likewise; empty: CUBA-LIF neurons alone.
    threshold, scale: of the states: units, and units per weight unit.
    surrogate: (centre, -log2(e) / width, height, exponent below which it is cut).
    n_neurons: without those that pad.
    delay: int8 delays of the synapses in blocks; empty: none has any.
    axonal: whether they are those of the inputs' axons.
    """

    table: Array
    table_unit: float
    ring: Array
    ring_unit: float
    n_inputs: int
    n_columns: int
    keep_u: Array
    keep_v: Array
    back_u: Array
    back_v: Array
    cross: Array
    back_cross: Array
    threshold: float
    scale: float
    integer: bool
    surrogate: tuple[float, float, float, float]
    n_neurons: int
    delay: Array
    axonal: bool


def padded_ring(recurrent: Array) -> Array:
    """Return recurrent weights with rows for padded neurons, which never fire; (0, 0) stays as it is."""
    n = len(recurrent)
    return np.pad(recurrent, ((0, padded(n) - n), (0, 0)))


def precision(arithmetic: Arithmetic) -> Any:
    """Return the type in which inputs, surrogates and gradients are held."""
    return np.float64 if arithmetic == "ideal" else np.float32


def layer_of(
    table: Array,
    ring: Array,
    n_inputs: int,
    n_neurons: int,
    population: Population[Any],
    arithmetic: Arithmetic,
    surrogate: Exponential | None = None,
    delay: Array = NO_DELAY,
    axonal: bool = False,
) -> KernelLayer:
    """Return a layer from matrices in blocks; int8 matrices are whole numbers on the grid of 1/32."""
    neurons = kernel_population(population)
    keep_u, keep_v = neurons.keep
    states = np.float32 if arithmetic == "float32" else np.float64
    scale = STATE_SCALE if arithmetic == "integer" else 1
    n = padded(n_neurons)

    def in_columns(factors: Floats, kind: Any) -> Floats:
        out = aligned(n, kind)
        out[:n_neurons] = factors
        return out

    def crossed(kind: Any) -> Floats:
        if isinstance(neurons, cuba_lif.Population):
            return aligned(0, kind)
        out = aligned(4 * n, kind)
        for k, factors in enumerate(neurons.cross):
            out[k * n : k * n + n_neurons] = factors
        return out

    return KernelLayer(
        table,
        1 / GRID if table.dtype == np.int8 else 1.0,
        ring,
        1 / GRID if ring.dtype == np.int8 else 1.0,
        n_inputs,
        n,
        in_columns(keep_u, states),
        in_columns(keep_v, states),
        in_columns(keep_u, precision(arithmetic)),
        in_columns(keep_v, precision(arithmetic)),
        crossed(states),
        crossed(precision(arithmetic)),
        neurons.threshold / WEIGHT_SCALE * scale,
        float(scale),
        arithmetic == "integer",
        _NO_SURROGATE if surrogate is None else surrogate.exponents(neurons.to_threshold),
        n_neurons,
        delay.ravel(),
        axonal,
    )


def laid_out(layer: Weights, arithmetic: Arithmetic, surrogate: Exponential | None = None) -> KernelLayer:
    """Return a layer as the kernels read it; weights on the 8-bit grid run as int8."""

    def matrix(w: Array) -> Array:
        whole = w * np.float32(GRID)
        small = arithmetic == "integer" and bool(
            (whole == np.rint(whole)).all() and (np.abs(whole + 0.5) < 128).all()
        )
        return packed(whole, np.int8) if small else packed(w, np.float32)

    return layer_of(
        matrix(layer.feed_forward),
        matrix(padded_ring(layer.recurrent)),
        layer.feed_forward.shape[0],
        layer.n_neurons,
        layer.population,
        arithmetic,
        surrogate,
        packed(layer.delay, np.int8) if layer.delay.size else NO_DELAY,
        layer.axonal,
    )


def _sum_delayed(
    layer: KernelLayer, offsets: Array, index: Array, first_row: int, n_samples: int, n_steps: int, z: Array
) -> None:
    """Write the weighted input of some samples of a layer whose synapses have delays."""
    n_spikes = offsets[first_row + n_samples * n_steps] - offsets[first_row]
    if n_spikes < layer.n_inputs * arrivals.break_even(n_samples, n_steps):
        starts, rows = arrivals.by_input(offsets, index, first_row, n_samples, n_steps, layer.n_inputs)
        starts, places = arrivals.places_of(np.arange(layer.n_inputs), starts, rows, n_steps)
        arrivals.add_up(
            starts,
            places,
            n_samples,
            n_steps,
            layer.table,
            layer.delay,
            layer.n_neurons,
            layer.n_columns,
            layer.table_unit,
            z,
        )
        return
    delays.add_up(
        delays.trains_of(offsets, index, first_row, n_samples, n_steps, layer.n_inputs),
        n_samples,
        n_steps,
        layer.table,
        layer.delay,
        layer.n_neurons,
        layer.n_columns,
        layer.table_unit,
        z,
    )


def run(
    layer: KernelLayer,
    offsets: Array,
    index: Array,
    first_row: int,
    n_samples: int,
    n_steps: int,
    what: int,
    z: Array,
    fired: Array,
    updates: Array,
    peak: Array,
    times: Array = ONCE,
    states: Array | None = None,
) -> int:
    """Run some samples through a layer; return the number of its spikes.

    Arguments are those of kernels.scan and kernels.gather.
    """
    if layer.delay.size > 0:
        # Not from compiled code: delays take as long to compile as all the rest, and few networks have any.
        _sum_delayed(layer, offsets, index, first_row, n_samples, n_steps, z)
    kept = z[:0] if states is None else states
    spikes = (offsets, index, times, first_row, n_samples, n_steps)
    return int(_run(layer, *spikes, what, z, fired, updates, peak, kept))


@compiled()
def _run(
    layer: KernelLayer,
    offsets: Array,
    index: Array,
    times: Array,
    first_row: int,
    n_samples: int,
    n_steps: int,
    what: int,
    z: Array,
    fired: Array,
    updates: Array,
    peak: Array,
    states: Array,
) -> int:
    """Run some samples through a layer whose weighted input, if delayed, is there; arguments as in `run`."""
    n_rows, n_groups = n_samples * n_steps, layer.n_columns // LANES
    recurrent, delayed = layer.ring.size > 0, layer.delay.size > 0
    n_fired, column = 0, 0
    while column < layer.n_columns:
        width = width_at(column, layer.n_columns)
        for n in range(n_samples):
            row = n * n_steps
            place = n_rows * column + row * width
            if not delayed:
                kernels.gather(
                    offsets,
                    index,
                    times,
                    first_row + row,
                    n_steps,
                    layer.table,
                    layer.n_inputs * column,
                    width,
                    layer.table_unit,
                    z,
                    place,
                    False,
                )
            if not recurrent:
                n_fired += kernels.scan(
                    z,
                    place,
                    n_steps,
                    width,
                    layer.keep_u,
                    layer.keep_v,
                    layer.cross,
                    column,
                    layer.threshold,
                    layer.scale,
                    layer.integer,
                    what,
                    layer.surrogate,
                    fired,
                    row * n_groups,
                    n_groups,
                    updates[row : row + n_steps],
                    peak,
                    states,
                )
        column += width
    if recurrent:
        sent = np.empty(layer.n_columns, np.int32)
        for n in range(n_samples):
            row = n * n_steps
            u, v = np.zeros_like(layer.keep_u), np.zeros_like(layer.keep_v)
            n_fired += kernels.scan_recurrent(
                z,
                n_rows,
                row,
                n_steps,
                layer.n_columns,
                layer.ring,
                layer.ring_unit,
                layer.keep_u,
                layer.keep_v,
                layer.cross,
                layer.threshold,
                layer.scale,
                layer.integer,
                what,
                layer.surrogate,
                fired,
                n_groups,
                updates[row : row + n_steps],
                peak,
                states,
                u,
                v,
                sent,
                0,
            )
    return n_fired


def arriving(layer: KernelLayer, offsets: Array, index: Array) -> Array:
    """Return the delayed weighted input of the last of some steps, (column,), given the spikes of all."""
    n_steps = offsets.size - 1
    z = aligned(n_steps * layer.n_columns, layer.back_u.dtype)
    _sum_delayed(layer, offsets, index, 0, 1, n_steps, z)
    return np.asarray(unpacked(z, n_steps, layer.n_columns)[-1])


@compiled()
def step(
    layer: KernelLayer,
    offsets: Array,
    index: Array,
    times: Array,
    z: Array,
    fired: Array,
    peak: Array,
    u: Array,
    v: Array,
    sent: Array,
    n_sent: int,
) -> int:
    """Run one step of a layer on from a state; return the number of its spikes, which `sent` lists.

    Its work grows with the input spikes and the neurons.

    Args:
        layer: as it runs.
        offsets: (2,) 0 and the number of input spikes.
        index: the inputs that spike.
        times: how often each does; empty: once.
        z: (column,) overwritten; of a layer with delays, what arrives.
        fired: (column / 16,) uint16, overwritten.
        peak: (16,) of the states' type, not read.
        u: (column,) states, which become those after the step.
        v: (column,) likewise.
        sent: (column,) neurons that fired in the step before, which become those that fire now.
        n_sent: how many fired in the step before.
    """
    column = layer.n_columns if layer.delay.size > 0 else 0
    while column < layer.n_columns:
        width = width_at(column, layer.n_columns)
        start = layer.n_inputs * column
        kernels.gather(
            offsets, index, times, 0, 1, layer.table, start, width, layer.table_unit, z, column, False
        )
        column += width
    n_fired: int = kernels.scan_recurrent(
        z,
        1,
        0,
        1,
        layer.n_columns,
        layer.ring,
        layer.ring_unit,
        layer.keep_u,
        layer.keep_v,
        layer.cross,
        layer.threshold,
        layer.scale,
        layer.integer,
        kernels.NOTHING,
        layer.surrogate,
        fired,
        layer.n_columns // LANES,
        fired[:0],
        peak,
        z[:0],
        u,
        v,
        sent,
        n_sent if layer.ring.size > 0 else 0,
    )
    return n_fired


@dataclass(frozen=True)
class Forward:
    """A layer's answer to a batch.

    voltage: (sample, step, neuron) membrane potential before reset, weight units; empty where not kept.
    fired: spikes as rows, at the step in which they were fired (not shifted).
    updates: (sample, step) int32 neurons with a non-zero potential or input; empty where not counted.
    peak: largest |u| or |v| in weight units.
    """

    voltage: Array
    fired: Rows
    updates: Array
    peak: float


@dataclass(frozen=True)
class CompiledLayer:
    """A layer laid out once for many calls of `forward`: how the kernels read it, and its neurons.

    pool: (input,) the row of the table that holds each input's weights; None: its own.
    """

    layer: KernelLayer
    n_neurons: int
    pool: Ints | None = None

    def forward(self, rows: Rows, *, keep_voltage: bool = False, count: bool = False) -> Forward:
        """Run the layer from rest over a batch.

        Raises:
            ValueError: the rows' inputs differ from the layer's.
        """
        ready, h = self.layer, self.n_neurons
        check_inputs(rows, ready.n_inputs if self.pool is None else self.pool.size)
        rows = pooled(rows, self.pool)
        n, t = rows.n_samples, rows.n_steps
        size = chunk_samples(n, t)
        z = aligned(size * t * ready.n_columns, ready.back_u.dtype, zeroed=False)
        n_groups = ready.n_columns // LANES
        fired = np.empty(n * t * n_groups, np.uint16)
        updates = np.zeros(n * t if count else 0, np.int32)
        peak = np.zeros(LANES, ready.keep_u.dtype)
        voltage = np.empty((n, t, h) if keep_voltage else (0, 0, 0), z.dtype)
        total = 0
        for first in range(0, n, size):
            m = min(size, n - first)
            row, end = first * t, (first + m) * t
            total += run(
                ready,
                rows.offsets,
                rows.index,
                row,
                m,
                t,
                kernels.VOLTAGE if keep_voltage else kernels.NOTHING,
                z,
                fired[row * n_groups : end * n_groups],
                updates[row:end],
                peak,
                rows.times,
            )
            if keep_voltage:
                voltage[first : first + m] = unpacked(z[: m * t * ready.n_columns], m * t, h).reshape(m, t, h)
        offsets = np.empty(n * t + 1, np.int64)
        index = np.empty(total, np.int32)
        kernels.decode(fired, n, t, n_groups, 0, _NONE, offsets, index)
        counted = updates.reshape(n, t) if count else np.zeros((0, 0), np.int32)
        return Forward(voltage, Rows(offsets, index, n, t, h), counted, float(peak.max()) / ready.scale)


def prepare(weights: Weights, arithmetic: Arithmetic) -> CompiledLayer:
    """Return a layer laid out for an arithmetic; its weights are as they run, rounded if deployed."""
    pool, rows = _equal_rows(weights)
    return CompiledLayer(laid_out(rows, arithmetic), weights.n_neurons, pool)


def _equal_rows(weights: Weights) -> tuple[Ints | None, Weights]:
    """Return the pools of inputs with equal weights, and the weights of each pool, where these are few."""
    matrix = weights.feed_forward
    most = len(matrix) // _FEW_POOLS
    if weights.delay.size or not matrix.size or len(np.unique(matrix[:, :4], axis=0)) > most:
        return None, weights
    whole = np.ascontiguousarray(matrix).view(np.dtype((np.void, matrix.itemsize * matrix.shape[1])))
    _, first, pool = np.unique(whole.ravel(), return_index=True, return_inverse=True)
    if first.size > most:
        return None, weights
    return pool.ravel(), replace(weights, feed_forward=matrix[first])


def check_inputs(rows: Rows, n_inputs: int) -> None:
    """Raise ValueError where a batch does not fit a first layer of `n_inputs`."""
    if rows.n_inputs != n_inputs:
        raise ValueError(f"rows have {rows.n_inputs} inputs, the layer has {n_inputs}")
