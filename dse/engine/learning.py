"""Gradients of a batch: chunks of samples forward through all layers, and back."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

import numpy as np

from dse.base.native.compiled import compiled
from dse.base.records import Array
from dse.engine import arrivals, decays, delays, kernels
from dse.engine.batch import Batch
from dse.engine.events import ONCE
from dse.engine.goal import Goal, by_spike, n_correct
from dse.engine.layers import KernelLayer, run
from dse.engine.layout import LANES, aligned, padded, width_at

_NO_UPDATES = np.zeros(0, np.int32)
_NO_GAIN = np.zeros((0, 0), np.float32)


@compiled()
def _back(
    layer: KernelLayer,
    n_samples: int,
    n_steps: int,
    by_column: Array,
    later: Array,
    n_later: int,
    back: Array,
    ring_back: Array,
    shift: int,
    penalty: Array,
    slope: Array,
) -> None:
    """Replace a layer's surrogate gradients by dL/dz (arguments as in kernels.scan_back)."""
    n_rows, column = n_samples * n_steps, 0
    if layer.ring.size > 0:
        for n in range(n_samples):
            kernels.scan_back_recurrent(
                slope,
                n_rows,
                n * n_steps,
                n_steps,
                layer.n_columns,
                ring_back,
                layer.back_u,
                layer.back_v,
                layer.back_cross,
                by_column[n],
                later,
                n_later,
                back,
                shift,
                penalty,
            )
        return
    while column < layer.n_columns:
        width = width_at(column, layer.n_columns)
        for n in range(n_samples):
            row = n * n_steps
            kernels.scan_back(
                slope,
                n_rows * column + row * width,
                n_steps,
                width,
                layer.back_u,
                layer.back_v,
                layer.back_cross,
                column,
                by_column[n],
                later,
                n_rows,
                row,
                n_later,
                back,
                layer.n_columns,
                shift,
                penalty,
            )
        column += width


@compiled()
def _follow(slope: Array, n_samples: int, n_steps: int, n_columns: int, ends: Array, factors: Array) -> None:
    """Multiply an output layer's surrogates by dL/ds where that depends on the step.

    Args:
        slope: in blocks.
        n_samples: of the chunk.
        n_steps: of a sample.
        n_columns: padded neurons.
        ends: (stretch,) the step after the last one of each stretch.
        factors: (sample, stretch, column).
    """
    n_rows, column = n_samples * n_steps, 0
    while column < n_columns:
        width = width_at(column, n_columns)
        for n in range(n_samples):
            stretch = 0
            for t in range(n_steps):
                while stretch + 1 < len(ends) and t >= ends[stretch]:
                    stretch += 1
                at = n_rows * column + (n * n_steps + t) * width
                for c in range(width):
                    slope[at + c] *= factors[n, stretch, column + c]
        column += width


@compiled()
def _gather_gradient(
    offsets: Array,
    index: Array,
    times: Array,
    n_inputs: int,
    n_columns: int,
    by_input: Array,
    n_rows: int,
    gradient: Array,
) -> None:
    """Add to each input's gradient the dL/dz of the rows in which it fires (kernels.transpose)."""
    column = 0
    while column < n_columns:
        width = width_at(column, n_columns)
        kernels.gather(
            offsets,
            index,
            times,
            0,
            n_inputs,
            by_input,
            n_rows * column,
            width,
            1.0,
            gradient,
            n_inputs * column,
            True,
        )
        column += width


@compiled()
def _scatter_gradient(
    offsets: Array, index: Array, n_inputs: int, n_columns: int, by_input: Array, n_rows: int, gradient: Array
) -> None:
    """Add dL/dz of each row to the gradients of the inputs that it lists."""
    column = 0
    while column < n_columns:
        width = width_at(column, n_columns)
        kernels.scatter(offsets, index, n_rows, by_input, n_rows * column, width, gradient, n_inputs * column)
        column += width


@compiled()
def _turn(table: Array, unit: float, n_rows: int, n_columns: int, out: Array) -> None:
    stride = -(-n_rows // LANES) * LANES
    column = 0
    while column < n_columns:
        width = width_at(column, n_columns)
        for i in range(n_rows):
            for c in range(width):
                out[(column + c) * stride + i] = table[n_rows * column + i * width + c] * unit
        column += width


class Workspace:
    """Buffers of one chunk, layer by layer: shared by networks that are trained one after another.

    Gradients of deeper layers are summed over a chunk before they are added to the batch's, and those of the
    first layer as well where chunks run side by side: sums keep one order, whatever the number of threads.
    """

    def __init__(
        self,
        n_rows: int,
        n_columns: Sequence[int],
        n_weights: Sequence[int],
        n_ring: Sequence[int],
        n_delays: Sequence[int],
        kind: Any,
    ) -> None:
        """Allocate.

        Args:
            n_rows: rows of a chunk.
            n_columns: neurons of each layer.
            n_weights: elements of each layer's gradient in blocks, 0 where it is written in place.
            n_ring: the same of recurrent weights.
            n_delays: the same of delays that are learnt.
            kind: precision of the gradients.
        """
        groups = [padded(n) // LANES for n in n_columns]
        self.slope = [aligned(n_rows * LANES * g, kind) for g in groups]
        self.fired = [np.empty(n_rows * g, np.uint16) for g in groups]
        self.offsets = [np.empty(n_rows + 1, np.int64) for _ in groups]
        # Pages of the index that no spike reaches cost nothing.
        self.index = [np.empty(n_rows * LANES * g, np.int32) for g in groups]
        widest = max((g for g, n in zip(groups, n_ring, strict=True) if n), default=0)
        self.own_offsets = np.empty(n_rows + 1, np.int64)
        self.own_index = np.empty(n_rows * LANES * widest, np.int32)
        self.gradients = [aligned(n, kind) for n in n_weights]
        self.ring_gradients = [aligned(n, kind) for n in n_ring]
        self.delay_gradients = [aligned(n, kind) for n in n_delays]
        self.decay_gradients = [np.zeros((2, padded(n))) for n in n_columns]
        self._by_neuron = aligned(0, kind)
        self._states = [aligned(0, kind) for _ in groups]

    def states(self, depth: int, size: int) -> Array:
        """Return room for both states of a layer, `size` numbers in all, the same at each call."""
        if self._states[depth].size < size:
            self._states[depth] = aligned(size, self._by_neuron.dtype, zeroed=False)
        return self._states[depth][:size]

    def by_neuron(self, n_columns: int, n_samples: int, stride: int) -> Array:
        """Return room for dL/dz by neuron, as `delays.turn` fills it, the same at each call."""
        size = n_columns * n_samples * stride
        if self._by_neuron.size < size:
            self._by_neuron = aligned(size, self._by_neuron.dtype, zeroed=False)
        return self._by_neuron[:size].reshape(n_columns, n_samples, stride)


@dataclass(frozen=True)
class Pass:
    """Loss of a batch (or of a part of it), correct answers, and each layer's number of spikes."""

    loss: float
    correct: int
    n_fired: Array


@dataclass(frozen=True)
class _Lesson:
    """What all chunks of a batch have in common for one network (arguments of `learn`).

    running: the layers, their weight units times the factor of their inputs' gains; units: without it.
    back: per layer, the weights by which the layer below hears of it; the first has none.
    ring_back: the same of recurrent weights.
    learns_delays, learns_decays: per layer, whether the gradient by its delays or decays is needed.
    """

    running: Sequence[KernelLayer]
    units: Sequence[float]
    n_neurons: Sequence[int]
    batch: Batch
    labels: Array
    soft: Array | None
    goal: Goal
    gains: Sequence[Array | None]
    shift: int
    back: Sequence[Array]
    ring_back: Sequence[Array]
    learns_delays: Sequence[bool]
    learns_decays: Sequence[bool]


def learn(
    layers: Sequence[KernelLayer],
    n_neurons: Sequence[int],
    batch: Batch,
    labels: Array,
    goal: Goal,
    gains: Sequence[Array | None],
    shift: int,
    spaces: Sequence[Workspace],
    gradients: Sequence[Array],
    ring_gradients: Sequence[Array],
    delay_gradients: Sequence[Array] = (),
    threads: Executor | None = None,
    soft: Array | None = None,
    decay_gradients: Sequence[Array] = (),
) -> Pass:
    """Add the gradients of a batch's loss by every weight, before the gains' common factors.

    The reset is ignored, rounding and truncation are straight-through (dse.engine.neurons.cuba_lif.backward).

    Args:
        layers: input side first, with surrogates.
        n_neurons: of each layer, without padding.
        batch: input spikes.
        labels: output neurons of the labels, (sample,), or (sample, head).
        goal: what training minimises.
        gains: per layer, (sample, input) factors of its input spikes, 0 or one common value; or None.
        shift: steps by which a layer hands its spikes on later.
        spaces: buffers, one per chunk that may run at a time; all but the first hold first-layer gradients.
        gradients: per layer, in blocks; added to.
        ring_gradients: the same of recurrent weights; empty where there are none.
        delay_gradients: the same of delays, times the gains' common factors; empty where none are learnt.
        threads: runs chunks side by side where there are several spaces.
        soft: (sample, class) probabilities in place of the labels; None: the labels.
        decay_gradients: per layer, (2, column) dL/d(1 - decay), added to; (2, 0) where none is learnt.
    """
    kind = spaces[0].slope[0].dtype
    factors = [common_factor(gain) for gain in gains]
    nothing = np.zeros(0, kind)
    lesson = _Lesson(
        [x._replace(table_unit=x.table_unit * f) for x, f in zip(layers, factors, strict=True)],
        [x.table_unit for x in layers],
        n_neurons,
        batch,
        labels,
        soft,
        goal,
        gains,
        shift,
        [nothing, *(_turned(x.table, x.table_unit, x.n_inputs, x.n_columns, kind) for x in layers[1:])],
        [_turned(x.ring, x.ring_unit, x.n_columns, x.n_columns, kind) for x in layers],
        [gradient.size > 0 for gradient in delay_gradients] or [False] * len(layers),
        [gradient.size > 0 for gradient in decay_gradients] or [False] * len(layers),
    )
    loss, correct, n_fired = 0.0, 0, np.zeros(len(layers), np.int64)
    n_chunks = len(batch.starts) - 1
    for first in range(0, n_chunks, len(spaces)):
        wave = range(first, min(first + len(spaces), n_chunks))
        targets = [gradients[0], *(space.gradients[0] for space in spaces[1:])]
        arguments = (itertools.repeat(lesson), wave, spaces, targets)
        done = (threads.map if threads else map)(_learn_chunk, *arguments)
        for number, part in enumerate(done):
            loss += part.loss
            correct += part.correct
            n_fired += part.n_fired
            space = spaces[number]
            _add(gradients[0 if number else 1 :], space.gradients[0 if number else 1 :])
            _add(ring_gradients, space.ring_gradients)
            _add(delay_gradients, space.delay_gradients)
            for total, summed in zip(decay_gradients, space.decay_gradients, strict=False):
                total += summed[:, : total.shape[1]]
                summed[:] = 0
    return Pass(loss, correct, n_fired)


def _add(totals: Sequence[Array], parts: Sequence[Array]) -> None:
    """Add the parts to the totals, and clear them; a shared space may have more layers than the network."""
    for total, part in zip(totals, parts, strict=False):
        total += part[: total.size]
        part[: total.size] = 0


def _learn_chunk(lesson: _Lesson, chunk: int, space: Workspace, first_gradient: Array) -> Pass:
    """Run a chunk of a batch forward and back; its gradients go to `first_gradient` and to the space."""
    first, end = (int(n) for n in lesson.batch.starts[chunk : chunk + 2])
    gains = [None if gain is None else gain[first:end] for gain in lesson.gains]
    n_fired = _forward(lesson, first, end, gains, space)

    last, n_steps, n = len(lesson.running) - 1, lesson.batch.rows.n_steps, end - first
    labels, goal, n_neurons = lesson.labels[first:end], lesson.goal, lesson.n_neurons[last]
    soft = None if lesson.soft is None else lesson.soft[first:end]
    outputs = goal.outputs(labels, n_steps, n_neurons, soft)
    ends = np.array(outputs.lengths) - lesson.shift
    n_columns = lesson.running[last].n_columns
    counts = np.zeros((n, len(ends), n_columns), np.int64)
    kernels.spike_counts(space.fired[last], n, n_steps, n_columns // LANES, ends, counts)
    counts = counts.cumsum(axis=1)[..., :n_neurons]
    loss, by_count = goal.loss.gradient(counts, outputs)
    _backward(lesson, chunk, n, gains, by_spike(by_count), ends, space, first_gradient)
    total = float(loss)
    if goal.hidden_spike_penalty:
        total += goal.hidden_spike_penalty * int(n_fired[:-1].sum())
    return Pass(total, n_correct(counts[:, -1], labels, goal.heads), n_fired)


def _forward(lesson: _Lesson, first: int, end: int, gains: Sequence[Array | None], space: Workspace) -> Array:
    """Run samples through all layers, keep surrogates and spikes; return each layer's number of spikes."""
    rows, n = lesson.batch.rows, end - first
    offsets, index, times, first_row = rows.offsets, rows.index, rows.times, first * rows.n_steps
    n_fired = np.zeros(len(lesson.running), np.int64)
    peak = np.zeros(LANES, lesson.running[0].keep_u.dtype)
    for d, layer in enumerate(lesson.running):
        if d:
            gain = gains[d]
            offsets, index, times, first_row = space.offsets[d - 1], space.index[d - 1], ONCE, 0
            kernels.decode(
                space.fired[d - 1],
                n,
                rows.n_steps,
                lesson.running[d - 1].n_columns // LANES,
                lesson.shift,
                _NO_GAIN if gain is None else gain,
                offsets,
                index,
            )
        n_fired[d] = run(
            layer,
            offsets,
            index,
            first_row,
            n,
            rows.n_steps,
            kernels.SLOPE,
            space.slope[d],
            space.fired[d],
            _NO_UPDATES,
            peak,
            times,
            space.states(d, 2 * n * rows.n_steps * layer.n_columns * lesson.learns_decays[d]),
        )
    return n_fired


def _backward(
    lesson: _Lesson,
    chunk: int,
    n: int,
    gains: Sequence[Array | None],
    by_output: Array,
    ends: Array,
    space: Workspace,
    first_gradient: Array,
) -> None:
    """Turn surrogates into dL/dz, the last layer first, and sum them into the weights' gradients.

    `by_output` is dL/ds of the last layer, (sample, stretch, neuron); `ends` are those of its stretches.
    """
    batch, n_steps, last = lesson.batch, lesson.batch.rows.n_steps, len(lesson.running) - 1
    kind = space.slope[0].dtype
    later, n_later, back = np.zeros(0, kind), 0, np.zeros(0, kind)
    factors: Array | float = by_output[:, 0]
    if len(ends) > 1:
        by_column = np.zeros((*by_output.shape[:2], lesson.running[-1].n_columns), kind)
        by_column[..., : by_output.shape[2]] = by_output
        _follow(space.slope[last], n, n_steps, by_column.shape[2], ends, by_column)
        factors = 1.0
    for d in range(last, -1, -1):
        layer, by_input, n_rows = lesson.running[d], space.slope[d], n * n_steps
        sizes = layer.n_inputs, layer.n_columns
        by_column = np.zeros((n, layer.n_columns), kind)
        by_column[:, : lesson.n_neurons[d]] = factors
        # Delays of the layer above have put all that a spike does to the loss into the surrogates.
        follows = d < last and lesson.running[d + 1].delay.size > 0
        penalised = bool(lesson.goal.hidden_spike_penalty) and d < last and not follows
        penalty = aligned(layer.n_columns if penalised else 0, kind)
        penalty[: lesson.n_neurons[d]] = lesson.goal.hidden_spike_penalty
        ring_back, shift = lesson.ring_back[d], 0 if follows else lesson.shift
        _back(layer, n, n_steps, by_column, later, n_later, back, ring_back, shift, penalty, by_input)
        if lesson.learns_decays[d]:
            states, gradient = space.states(d, 2 * n_rows * layer.n_columns), space.decay_gradients[d]
            decays.add_gradients(by_input, states, n, n_steps, layer.n_columns, layer.back_u, gradient)
        if layer.delay.size:
            _through_delays(lesson, chunk, d, n, gains[d], space, first_gradient)
            factors, later, n_later, back = 1.0, later[:0], 0, back[:0]
        elif d == 0:
            firing = batch.offsets[chunk], batch.index, batch.times
            _gather_gradient(*firing, *sizes, by_input, n_rows, first_gradient)
        else:
            offsets, index, gradient = space.offsets[d - 1], space.index[d - 1], space.gradients[d]
            _scatter_gradient(offsets, index, *sizes, by_input, n_rows, gradient)
            gain = gains[d]
            factors = 1.0 if gain is None else gain
            later, n_later, back = by_input, lesson.n_neurons[d], lesson.back[d]
        if layer.ring.size:
            offsets, index, gradient = space.own_offsets, space.own_index, space.ring_gradients[d]
            n_groups = layer.n_columns // LANES
            kernels.decode(space.fired[d], n, n_steps, n_groups, 1, _NO_GAIN, offsets, index)
            _scatter_gradient(offsets, index, layer.n_columns, layer.n_columns, by_input, n_rows, gradient)


def _through_delays(
    lesson: _Lesson,
    chunk: int,
    depth: int,
    n: int,
    gain: Array | None,
    space: Workspace,
    first_gradient: Array,
) -> None:
    """Sum dL/dz of a layer with delays into its gradients, and take it back to the layer below."""
    layer, rows = lesson.running[depth], lesson.batch.rows
    n_steps = rows.n_steps
    offsets, index, first_row = rows.offsets, rows.index, int(lesson.batch.starts[chunk]) * n_steps
    if depth:
        offsets, index, first_row = space.offsets[depth - 1], space.index[depth - 1], 0
    by_neuron = space.by_neuron(layer.n_columns, n, arrivals.stride_of(n_steps))
    delays.turn(space.slope[depth], n, n_steps, by_neuron)
    of_layer = (
        by_neuron,
        n_steps,
        layer.table,
        layer.delay,
        layer.n_neurons,
        layer.table_unit,
        layer.axonal,
        space.gradients[depth] if depth else first_gradient,
        space.delay_gradients[depth] if lesson.learns_delays[depth] else by_neuron.ravel()[:0],
    )
    starts, firing_rows = lesson.batch.offsets[chunk], lesson.batch.index
    if depth:
        starts, firing_rows = arrivals.by_input(offsets, index, first_row, n, n_steps, layer.n_inputs)
    few = np.diff(starts) < arrivals.break_even(n, n_steps)
    if few.any():
        inputs = np.flatnonzero(few)
        spikes = arrivals.places_of(inputs, starts, firing_rows, n_steps)
        arrivals.add_gradients(inputs, *spikes, layer.n_inputs, *of_layer)
    if not few.all():
        trains = delays.trains_of(offsets, index, first_row, n, n_steps, layer.n_inputs)
        delays.add_gradients(np.flatnonzero(~few), trains, *of_layer)
    if depth:
        delays.follow_back(
            by_neuron,
            n_steps,
            layer.table,
            layer.delay,
            layer.n_neurons,
            lesson.units[depth],
            np.ones((n, layer.n_inputs), np.float32) if gain is None else gain,
            lesson.goal.hidden_spike_penalty,
            space.slope[depth - 1],
            layer.n_inputs,
            lesson.shift,
        )


def common_factor(gain: Array | None) -> float:
    """Return the one factor of a layer's input spikes that are not silenced."""
    return float(gain.max()) if gain is not None and gain.size else 1.0


def _turned(table: Array, unit: float, n_rows: int, n_columns: int, kind: Any) -> Array:
    """Return a matrix in blocks, in weight units, as (column, row) with rows padded to whole vectors."""
    if not table.size:
        return np.zeros(0, kind)
    out = aligned(n_columns * padded(n_rows), kind)
    _turn(table, unit, n_rows, n_columns, out)
    return out
