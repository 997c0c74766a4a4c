"""Gradients of a batch: chunks of samples forward through all layers, and back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from dse.engine import kernels
from dse.engine.batch import Batch
from dse.engine.compiled import compiled
from dse.engine.layers import Layer, run
from dse.engine.layout import LANES, aligned, padded, width_at
from dse.engine.loss import spike_rate
from dse.records import Array

_NO_UPDATES = np.zeros(0, np.int32)
_NO_GAIN = np.zeros((0, 0), np.float32)


@compiled()
def _back(
    layer: Layer,
    n_samples: int,
    n_steps: int,
    by_column: Array,
    later: Array,
    n_later: int,
    back: Array,
    ring_back: Array,
    shift: int,
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
                by_column[n],
                later,
                n_later,
                back,
                shift,
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
                column,
                by_column[n],
                later,
                n_rows,
                row,
                n_later,
                back,
                layer.n_columns,
                shift,
            )
        column += width


@compiled()
def _gather_gradient(
    offsets: Array, index: Array, n_inputs: int, n_columns: int, by_input: Array, n_rows: int, gradient: Array
) -> None:
    """Add to each input's gradient the dL/dz of the rows in which it fires (kernels.transpose)."""
    column = 0
    while column < n_columns:
        width = width_at(column, n_columns)
        kernels.gather(
            offsets,
            index,
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
def _turned(table: Array, unit: float, n_rows: int, n_columns: int, out: Array) -> None:
    stride = -(-n_rows // LANES) * LANES
    column = 0
    while column < n_columns:
        width = width_at(column, n_columns)
        for i in range(n_rows):
            for c in range(width):
                out[(column + c) * stride + i] = table[n_rows * column + i * width + c] * unit
        column += width


class Workspace:
    """Buffers of one chunk, layer by layer: shared by all networks that are trained one after another."""

    def __init__(self, n_rows: int, n_columns: Sequence[int], kind: Any) -> None:
        groups = [padded(n) // LANES for n in n_columns]
        self.slope = [aligned(n_rows * LANES * g, kind) for g in groups]
        self.fired = [np.empty(n_rows * g, np.uint16) for g in groups]
        self.offsets = [np.empty(n_rows + 1, np.int64) for _ in groups]
        # Pages of the index that no spike reaches cost nothing.
        self.index = [np.empty(n_rows * LANES * g, np.int32) for g in groups]
        self.own_offsets = np.empty(n_rows + 1, np.int64)
        self.own_index = np.empty(n_rows * LANES * max(groups, default=0), np.int32)


@dataclass(frozen=True)
class Pass:
    """Loss of a batch, correct answers, and each layer's number of spikes."""

    loss: float
    correct: int
    n_fired: tuple[int, ...]


def learn(
    layers: Sequence[Layer],
    n_neurons: Sequence[int],
    batch: Batch,
    labels: Array,
    true_rate: float,
    false_rate: float,
    gains: Sequence[Array | None],
    shift: int,
    space: Workspace,
    gradients: Sequence[Array],
    ring_gradients: Sequence[Array],
) -> Pass:
    """Add the gradients of a batch's SpikeRate loss by every weight, before the gains' common factors.

    The reset is ignored, rounding and truncation are straight-through (dse.neurons.cuba_lif.backward).

    Args:
        layers: input side first, with surrogates.
        n_neurons: of each layer, without padding.
        batch: input spikes.
        labels: (sample,) class numbers.
        true_rate: target rate of the label's output.
        false_rate: target rate of the other outputs.
        gains: per layer, (sample, input) factors of its input spikes, 0 or one common value; or None.
        shift: steps by which a layer hands its spikes on later.
        space: buffers of one chunk.
        gradients: per layer, in blocks; added to.
        ring_gradients: the same of recurrent weights; empty where there are none.
    """
    rows, n_steps, last = batch.rows, batch.rows.n_steps, len(layers) - 1
    kind = space.slope[0].dtype
    factors = [common_factor(gain) for gain in gains]
    running = [x._replace(table_unit=x.table_unit * f) for x, f in zip(layers, factors, strict=True)]
    back = [_back_weights(x.table, x.table_unit, x.n_inputs, x.n_columns, kind) for x in layers[1:]]
    rings = [_back_weights(x.ring, x.ring_unit, x.n_columns, x.n_columns, kind) for x in layers]
    n_classes = n_neurons[last]
    peak = np.zeros(LANES, layers[0].keep_u.dtype)
    loss, correct, n_fired = 0.0, 0, [0] * len(layers)
    for chunk, (first, end) in enumerate(pairwise(batch.starts.tolist())):
        n = end - first
        n_rows = n * n_steps
        offsets, index, first_row = rows.offsets, rows.index, first * n_steps
        silenced = [None if gain is None else gain[first:end] for gain in (*gains[1:], None)]
        for d, layer in enumerate(running):
            n_fired[d] += run(
                layer,
                offsets,
                index,
                first_row,
                n,
                n_steps,
                kernels.SLOPE,
                space.slope[d],
                space.fired[d],
                _NO_UPDATES,
                peak,
            )
            if d < last:
                offsets, index, first_row = space.offsets[d], space.index[d], 0
                gain = silenced[d]
                kernels.decode(
                    space.fired[d],
                    n,
                    n_steps,
                    layer.n_columns // LANES,
                    shift,
                    _NO_GAIN if gain is None else gain,
                    offsets,
                    index,
                )
        counts = np.zeros((n, layers[last].n_columns), np.int64)
        n_groups = layers[last].n_columns // LANES
        kernels.spike_counts(space.fired[last], n, n_steps, n_groups, n_steps - shift, counts)
        answers = counts[:, :n_classes]
        part, by_class = spike_rate(answers, n_steps, labels[first:end], true_rate, false_rate)
        loss += part
        correct += int((answers.argmax(axis=1) == labels[first:end]).sum())

        later, n_later, weights_back = np.zeros(0, kind), 0, np.zeros(0, kind)
        by_column = np.zeros((n, layers[last].n_columns), kind)
        by_column[:, :n_classes] = by_class
        for d in range(last, -1, -1):
            layer, slope = layers[d], space.slope[d]
            _back(layer, n, n_steps, by_column, later, n_later, weights_back, rings[d], shift, slope)
            if d == 0:
                _gather_gradient(
                    batch.offsets[chunk],
                    batch.index,
                    rows.n_inputs,
                    layer.n_columns,
                    slope,
                    n_rows,
                    gradients[0],
                )
            else:
                _scatter_gradient(
                    space.offsets[d - 1],
                    space.index[d - 1],
                    layer.n_inputs,
                    layer.n_columns,
                    slope,
                    n_rows,
                    gradients[d],
                )
                by_column = np.zeros((n, layers[d - 1].n_columns), kind)
                gain = silenced[d - 1]
                by_column[:, : n_neurons[d - 1]] = 1 if gain is None else gain
                later, n_later, weights_back = slope, n_neurons[d], back[d - 1]
            if layer.ring.size:
                kernels.decode(
                    space.fired[d],
                    n,
                    n_steps,
                    layer.n_columns // LANES,
                    1,
                    _NO_GAIN,
                    space.own_offsets,
                    space.own_index,
                )
                _scatter_gradient(
                    space.own_offsets,
                    space.own_index,
                    layer.n_columns,
                    layer.n_columns,
                    slope,
                    n_rows,
                    ring_gradients[d],
                )
    return Pass(loss, correct, tuple(n_fired))


def common_factor(gain: Array | None) -> float:
    """Return the one factor of a layer's input spikes that are not silenced."""
    return float(gain.max()) if gain is not None and gain.size else 1.0


def _back_weights(table: Array, unit: float, n_rows: int, n_columns: int, kind: Any) -> Array:
    """Return a matrix in blocks, in weight units, as (column, row) with rows padded to whole vectors."""
    if not table.size:
        return np.zeros(0, kind)
    out = aligned(n_columns * padded(n_rows), kind)
    _turned(table, unit, n_rows, n_columns, out)
    return out
