"""CUBA-LIF layers on the CPU: sparse rows in, sparse rows out, gradients scattered back.

The equations are those of dse.neurons.cuba_lif; integer states are held in float64, where they are
exact up to 2**40 (products of state and decay stay below 2**53), so that the loops vectorise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from dse.engine.events import Rows
from dse.neurons.cuba_lif import DECAY_SCALE, STATE_SCALE, WEIGHT_SCALE
from dse.neurons.surrogate import Exponential
from dse.records import Array

_NONE = np.zeros((0, 0), np.float32)


@dataclass(frozen=True)
class Weights:
    """What the engine runs of a layer: weights by input (input, neuron), so that a spike reads one row.

    feed_forward: (input, neuron) float32.
    recurrent: (neuron, neuron) float32, row = presynaptic; (0, 0) where there is none.
    keep_current, keep_voltage: (neuron,) float64 factors (4096 - d) / 4096.
    threshold: integer mantissa.
    """

    feed_forward: Array
    recurrent: Array
    keep_current: Array
    keep_voltage: Array
    threshold: int

    @property
    def n_neurons(self) -> int:
        return int(self.feed_forward.shape[1])


def weights(
    feed_forward: Array, recurrent: Array | None, decay_current: Array, decay_voltage: Array, threshold: int
) -> Weights:
    """Return engine weights from (input, neuron) matrices and integer decays, scalar or (neuron,)."""
    n = feed_forward.shape[1]
    keep = [(DECAY_SCALE - np.asarray(d, np.float64)) / DECAY_SCALE for d in (decay_current, decay_voltage)]
    return Weights(
        np.ascontiguousarray(feed_forward, np.float32),
        _NONE if recurrent is None else np.ascontiguousarray(recurrent, np.float32),
        np.broadcast_to(keep[0], n).copy(),
        np.broadcast_to(keep[1], n).copy(),
        threshold,
    )


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


@numba.njit(cache=True)
def _forward(
    offsets: Array,
    index: Array,
    gain: Array,
    n_samples: int,
    n_steps: int,
    feed_forward: Array,
    recurrent: Array,
    keep_u: Array,
    keep_v: Array,
    threshold: float,
    integer: bool,
    z: Array,
    voltage: Array,
    fired_offsets: Array,
    fired_index: Array,
    updates: Array,
) -> float:
    n_neurons = feed_forward.shape[1]
    keep_voltage = voltage.size > 0
    count_updates = updates.size > 0
    has_gain = gain.size > 0
    has_recurrent = recurrent.size > 0
    u = np.empty(n_neurons)
    v = np.empty(n_neurons)
    before = np.empty(n_neurons)
    scale = 1.0 / STATE_SCALE if integer else 1.0
    peak = 0.0
    position = 0
    fired_offsets[0] = 0
    for n in range(n_samples):
        u[:] = 0.0
        v[:] = 0.0
        for t in range(n_steps):
            row = n * n_steps + t
            z[:] = 0.0
            if has_gain:
                for e in range(offsets[row], offsets[row + 1]):
                    i = index[e]
                    g = gain[n, i]
                    if g != 0.0:
                        for o in range(n_neurons):
                            z[o] += g * feed_forward[i, o]
            else:
                for e in range(offsets[row], offsets[row + 1]):
                    i = index[e]
                    for o in range(n_neurons):
                        z[o] += feed_forward[i, o]
            if has_recurrent and t > 0:
                for e in range(fired_offsets[row - 1], fired_offsets[row]):
                    i = fired_index[e]
                    for o in range(n_neurons):
                        z[o] += recurrent[i, o]
            if integer:
                for o in range(n_neurons):
                    u[o] = np.trunc(u[o] * keep_u[o]) + np.trunc(np.float64(z[o]) * STATE_SCALE)
                    before[o] = np.trunc(v[o] * keep_v[o]) + u[o]
                    v[o] = 0.0 if before[o] > threshold else before[o]
            else:
                for o in range(n_neurons):
                    u[o] = u[o] * keep_u[o] + z[o]
                    before[o] = v[o] * keep_v[o] + u[o]
                    v[o] = 0.0 if before[o] > threshold else before[o]
            if keep_voltage:
                for o in range(n_neurons):
                    voltage[n, t, o] = before[o] * scale
            if count_updates:
                touched = 0
                for o in range(n_neurons):
                    touched += 1 if (before[o] != 0.0 or z[o] != 0.0) else 0
                    peak = max(peak, abs(u[o]), abs(before[o]))
                updates[n, t] = touched
            for o in range(n_neurons):
                if before[o] > threshold:
                    fired_index[position] = o
                    position += 1
            fired_offsets[row + 1] = position
    return peak * scale


def forward(
    rows: Rows,
    layer: Weights,
    *,
    integer: bool,
    keep_voltage: bool = False,
    count: bool = False,
    gain: Array | None = None,
) -> Forward:
    """Run a layer from rest over a batch.

    Args:
        rows: input spikes.
        layer: weights as they run (already rounded where they are deployed).
        integer: integer arithmetic; otherwise real-valued states.
        keep_voltage: keep the membrane potential (what a backward pass needs).
        count: count neuron updates and the largest state.
        gain: (sample, input) float32 factor of each input's spikes (dropout), or None.

    Raises:
        ValueError: the rows' inputs differ from the layer's.
    """
    if rows.n_inputs != layer.feed_forward.shape[0]:
        raise ValueError(f"rows have {rows.n_inputs} inputs, the layer expects {layer.feed_forward.shape[0]}")
    n, t, h = rows.n_samples, rows.n_steps, layer.n_neurons
    kind = np.float32 if integer else np.float64
    voltage = np.empty((n, t, h) if keep_voltage else (0, 0, 0), kind)
    fired_offsets = np.empty(n * t + 1, np.int64)
    fired_index = np.empty(n * t * h, np.int32)  # pages that stay untouched cost nothing
    updates = np.zeros((n, t) if count else (0, 0), np.int32)
    peak = _forward(
        rows.offsets,
        rows.index,
        _NONE if gain is None else gain,
        n,
        t,
        layer.feed_forward,
        layer.recurrent,
        layer.keep_current,
        layer.keep_voltage,
        layer.threshold * (STATE_SCALE // WEIGHT_SCALE) if integer else layer.threshold / WEIGHT_SCALE,
        integer,
        np.empty(h, kind),
        voltage,
        fired_offsets,
        fired_index,
        updates,
    )
    fired = Rows(fired_offsets, fired_index[: fired_offsets[-1]], n, t, h)
    return Forward(voltage, fired, updates, peak)


def delayed(fired: Rows) -> Rows:
    """Return the spikes one step later, as the next layer sees them; the last step's spikes are lost."""
    n, t = fired.n_samples, fired.n_steps
    counts = fired.per_step()
    kept = np.zeros((n, t), np.int64)
    kept[:, 1:] = counts[:, :-1]
    offsets = np.concatenate([[0], np.cumsum(kept.ravel())])
    lost = np.zeros((n, t), bool)
    lost[:, -1] = True
    index = fired.index[~np.repeat(lost.ravel(), counts.ravel())]
    return Rows(offsets, index, n, t, fired.n_inputs)


def dense(rows: Rows) -> Array:
    """Return rows as a dense (sample, step, input) uint8 array: for outputs and tests, never for inputs."""
    out = np.zeros((rows.n_samples * rows.n_steps, rows.n_inputs), np.uint8)
    out[np.repeat(np.arange(len(out)), np.diff(rows.offsets)), rows.index] = 1
    return out.reshape(rows.n_samples, rows.n_steps, rows.n_inputs)


@numba.njit(cache=True, fastmath={"contract", "reassoc", "nsz"})
def _backward(
    offsets: Array,
    index: Array,
    gain: Array,
    fired_offsets: Array,
    fired_index: Array,
    slope: Array,
    grad_spikes: Array,
    recurrent: Array,
    keep_u: Array,
    keep_v: Array,
    grad_input: Array,
    grad_weight: Array,
    grad_recurrent: Array,
) -> None:
    """Fill dL/dz and add to the weight gradients; all sums in the arrays' own precision."""
    n_samples, n_steps, n_neurons = slope.shape
    has_gain = gain.size > 0
    has_recurrent = recurrent.size > 0
    zero = grad_weight.dtype.type(0)
    lv = np.empty(n_neurons, grad_weight.dtype)
    lu = np.empty(n_neurons, grad_weight.dtype)
    g = np.empty(n_neurons, grad_weight.dtype)
    for n in range(n_samples):
        lv[:] = zero
        lu[:] = zero
        for t in range(n_steps - 1, -1, -1):
            row = n * n_steps + t
            for o in range(n_neurons):
                g[o] = grad_spikes[n, t, o]
            if has_recurrent and t < n_steps - 1:
                for i in range(n_neurons):
                    total = zero
                    for o in range(n_neurons):
                        total += recurrent[i, o] * lu[o]
                    g[i] += total
            for o in range(n_neurons):
                lv[o] = keep_v[o] * lv[o] + g[o] * slope[n, t, o]
                lu[o] = keep_u[o] * lu[o] + lv[o]
                grad_input[n, t, o] = lu[o]
            if has_gain:
                for e in range(offsets[row], offsets[row + 1]):
                    i = index[e]
                    factor = gain[n, i]
                    if factor != zero:
                        for o in range(n_neurons):
                            grad_weight[i, o] += factor * lu[o]
            else:
                for e in range(offsets[row], offsets[row + 1]):
                    i = index[e]
                    for o in range(n_neurons):
                        grad_weight[i, o] += lu[o]
            if has_recurrent and t > 0:
                for e in range(fired_offsets[row - 1], fired_offsets[row]):
                    i = fired_index[e]
                    for o in range(n_neurons):
                        grad_recurrent[i, o] += lu[o]


def backward(
    rows: Rows,
    layer: Weights,
    answer: Forward,
    grad_spikes: Array,
    surrogate: Exponential,
    *,
    gain: Array | None = None,
) -> tuple[Array, Array, Array]:
    """Return the gradients of a layer by its inputs z, its weights and its recurrent weights.

    The reset is ignored, rounding and truncation are straight-through (dse.neurons.cuba_lif.backward).

    Args:
        rows: the input spikes of the forward pass.
        layer: the weights of the forward pass.
        answer: what `forward` returned with `keep_voltage`.
        grad_spikes: dL/ds at the firing step, (sample, step, neuron).
        surrogate: ds/dv.
        gain: as in the forward pass.

    Returns:
        dL/dz (sample, step, neuron); dL/dW (input, neuron); dL/dR (neuron, neuron) or (0, 0).
        Precision follows the membrane potential that was kept: float32 (integer) or float64 (ideal).
    """
    kind = answer.voltage.dtype
    grad_input = np.empty(answer.voltage.shape, kind)
    grad_weight = np.zeros(layer.feed_forward.shape, kind)
    grad_recurrent = np.zeros(layer.recurrent.shape, kind)
    _backward(
        rows.offsets,
        rows.index,
        np.zeros((0, 0), kind) if gain is None else gain.astype(kind, copy=False),
        answer.fired.offsets,
        answer.fired.index,
        surrogate(answer.voltage),
        grad_spikes.astype(kind, copy=False),
        layer.recurrent.astype(kind, copy=False),
        layer.keep_current.astype(kind),
        layer.keep_voltage.astype(kind),
        grad_input,
        grad_weight,
        grad_recurrent,
    )
    return grad_input, grad_weight, grad_recurrent
