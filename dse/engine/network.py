"""A stack of layers: forward for answers; of layers with kernels, forward and backward for gradients."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dse.base.records import Arithmetic, Array
from dse.engine.batch import batch_of, chunk_samples
from dse.engine.events import Rows, delayed, dense
from dse.engine.forward import Prepared
from dse.engine.goal import SPIKE_RATE, Goal
from dse.engine.layers import Weights, check_inputs, laid_out, precision
from dse.engine.layout import aligned, unpacked
from dse.engine.learning import Workspace, common_factor, learn
from dse.engine.losses import Loss
from dse.engine.neurons.surrogate import Exponential


@dataclass(frozen=True)
class Gradients:
    """Loss of a batch and its gradients, one entry per layer.

    feed_forward: (input, neuron) each; recurrent: (neuron, neuron), or (0, 0) where there is none.
    fired: (layer,) mean spikes per neuron and step.
    correct: samples whose most active output (lowest number on ties) is the label, in every head.
    delay: (input, neuron) each, or (0, 0) where synapses have none.
    keep: (2, neuron) each, dL/d(1 - decay) of u and of v; empty where it was not asked for.
    """

    loss: float
    feed_forward: tuple[Array, ...]
    recurrent: tuple[Array, ...]
    fired: tuple[float, ...]
    correct: int
    delay: tuple[Array, ...] = ()
    keep: tuple[Array, ...] = ()


def gradients(
    rows: Rows,
    layers: Sequence[Weights],
    surrogates: Sequence[Exponential],
    labels: Array,
    *,
    true_rate: float,
    false_rate: float,
    arithmetic: Arithmetic = "integer",
    gains: Sequence[Array | None],
    shift: bool = True,
    heads: tuple[int, ...] = (),
    loss: Loss = SPIKE_RATE,
    hidden_spike_penalty: float = 0.0,
    soft: Array | None = None,
    of_decays: bool = False,
) -> Gradients:
    """Return the loss of a batch and its gradients by every weight as it ran.

    Args:
        rows: input spikes of the batch.
        layers: weights, input side first.
        surrogates: ds/dv of each layer.
        labels: output neurons of the labels, (sample,), or (sample, head).
        true_rate: target rate of the label's output.
        false_rate: target rate of the other outputs.
        arithmetic: of the states.
        gains: per layer, (sample, input) factors of its input spikes (dropout), 0 or one value; or None.
        shift: each layer hands its spikes on one step later (SLAYER's `delay_shift`).
        heads: classes of each head; empty: one head.
        loss: over the output spikes.
        hidden_spike_penalty: what each spike of a hidden neuron adds to the loss of its sample.
        soft: (sample, class) probabilities in place of the labels; None: the labels.
        of_decays: also by the decays of CUBA-LIF neurons.

    Raises:
        ValueError: the rows' inputs differ from the first layer's.
    """
    check_inputs(rows, layers[0].feed_forward.shape[0])
    ready = [laid_out(w, arithmetic, s) for w, s in zip(layers, surrogates, strict=True)]
    kind = precision(arithmetic)
    sizes = [w.n_neurons for w in layers]
    feed_forward = [aligned(x.n_inputs * x.n_columns, kind) for x in ready]
    rings = [aligned(x.ring.size, kind) for x in ready]
    n_rows = chunk_samples(rows.n_samples, rows.n_steps) * rows.n_steps
    deeper = [0, *(g.size for g in feed_forward[1:])]
    delays = [aligned(g.size if x.delay.size else 0, kind) for g, x in zip(feed_forward, ready, strict=True)]
    space = Workspace(n_rows, sizes, deeper, [r.size for r in rings], [d.size for d in delays], kind)
    keep = [np.zeros((2, x.n_columns if of_decays else 0)) for x in ready]
    done = learn(
        ready,
        sizes,
        batch_of(rows),
        labels,
        Goal(loss, true_rate, false_rate, heads, hidden_spike_penalty),
        gains,
        int(shift),
        [space],
        feed_forward,
        rings,
        delays,
        soft=soft,
        decay_gradients=keep,
    )
    factors = [common_factor(gain) for gain in gains]
    cells = rows.n_samples * rows.n_steps
    return Gradients(
        done.loss,
        tuple(
            unpacked(g, x.n_inputs, n) * kind(f)
            for g, x, n, f in zip(feed_forward, ready, sizes, factors, strict=True)
        ),
        tuple(
            unpacked(g, x.n_columns, n)[:n] if g.size else g.reshape(0, 0)
            for g, x, n in zip(rings, ready, sizes, strict=True)
        ),
        tuple(float(f) / max(1, cells * n) for f, n in zip(done.n_fired, sizes, strict=True)),
        done.correct,
        tuple(
            unpacked(g, x.n_inputs, n) if g.size else g.reshape(0, 0)
            for g, x, n in zip(delays, ready, sizes, strict=True)
        ),
        tuple(k[:, :n] for k, n in zip(keep, sizes, strict=True)) if of_decays else (),
    )


@dataclass(frozen=True)
class Answer:
    """What a stack did on a batch.

    output: (sample, step, class) uint8, shift included.
    spikes: (sample, step, layer) int32, layer 0 = the input rows.
    updates: (sample, step, layer - 1) int32.
    fired: per layer, (sample, neuron) spikes.
    peak: largest |u| or |v| over all layers, weight units.
    """

    output: Array
    spikes: Array
    updates: Array
    fired: tuple[Array, ...]
    peak: float


def layer_spikes(rows: Rows, layers: Sequence[Prepared]) -> tuple[Rows, ...]:
    """Return the spikes of every layer over a batch, in the step in which they fire."""
    spikes = []
    for layer in layers:
        spikes.append(layer.forward(rows).fired)
        rows = delayed(spikes[-1])
    return tuple(spikes)


def answer(rows: Rows, layers: Sequence[Prepared]) -> Answer:
    """Run a stack over a batch, and count its spikes and updates."""
    spikes, updates, fired = [rows.per_step()], [], []
    peak = 0.0
    for layer in layers:
        done = layer.forward(rows, count=True)
        spikes.append(done.fired.per_step())
        updates.append(done.updates)
        fired.append(done.fired.per_input())
        peak = max(peak, done.peak)
        rows = delayed(done.fired)
    return Answer(dense(rows), np.stack(spikes, -1), np.stack(updates, -1), tuple(fired), peak)
