"""A stack of CUBA-LIF layers: forward for answers, forward and backward for gradients."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dse.engine import cpu
from dse.engine.events import Rows
from dse.engine.loss import spike_rate
from dse.neurons.surrogate import Exponential
from dse.records import Array


@dataclass(frozen=True)
class Gradients:
    """Loss of a batch and its gradients, one entry per layer.

    feed_forward: (input, neuron) each; recurrent: (neuron, neuron), or (0, 0) where there is none.
    fired: (layer,) mean spikes per neuron and step.
    correct: samples whose most active output (lowest number on ties) is the label.
    """

    loss: float
    feed_forward: tuple[Array, ...]
    recurrent: tuple[Array, ...]
    fired: tuple[float, ...]
    correct: int


def gradients(
    rows: Rows,
    layers: Sequence[cpu.Weights],
    surrogates: Sequence[Exponential],
    labels: Array,
    *,
    true_rate: float,
    false_rate: float,
    integer: bool,
    gains: Sequence[Array | None],
    shift: bool = True,
) -> Gradients:
    """Return the SpikeRate loss of a batch and its gradients by every weight as it ran.

    Args:
        rows: input spikes of the batch.
        layers: weights, input side first.
        surrogates: ds/dv of each layer.
        labels: (sample,) class numbers.
        true_rate: target rate of the label's output.
        false_rate: target rate of the other outputs.
        integer: integer arithmetic; otherwise real-valued states.
        gains: per layer, (sample, input) factors of its input spikes (dropout), or None.
        shift: each layer hands its spikes on one step later (SLAYER's `delay_shift`).
    """
    inputs = [rows]
    answers = []
    for layer, gain in zip(layers, gains, strict=True):
        answers.append(cpu.forward(inputs[-1], layer, integer=integer, keep_voltage=True, gain=gain))
        inputs.append(cpu.delayed(answers[-1].fired) if shift else answers[-1].fired)
    output = cpu.dense(inputs[-1])
    loss, by_class = spike_rate(output, labels, true_rate, false_rate)
    correct = int((output.sum(axis=1, dtype=np.int64).argmax(axis=1) == labels).sum())

    kind = answers[-1].voltage.dtype
    grad_spikes = np.repeat(by_class.astype(kind)[:, None], rows.n_steps, axis=1)
    if shift:
        grad_spikes[:, -1] = 0  # the last step's spikes never leave the layer
    feed_forward, recurrent = [], []
    for depth in range(len(layers) - 1, -1, -1):
        layer, gain = layers[depth], gains[depth]
        by_input, by_weight, by_recurrent = cpu.backward(
            inputs[depth], layer, answers[depth], grad_spikes, surrogates[depth], gain=gain
        )
        feed_forward.append(by_weight)
        recurrent.append(by_recurrent)
        if depth:
            passed = by_input @ layer.feed_forward.T.astype(kind)
            if gain is not None:
                passed *= gain[:, None]
            grad_spikes = passed
            if shift:
                grad_spikes = np.zeros_like(passed)
                grad_spikes[:, :-1] = passed[:, 1:]
    fired = tuple(
        x.fired.index.size / max(1, x.fired.n_samples * x.fired.n_steps * x.fired.n_inputs) for x in answers
    )
    return Gradients(loss, tuple(feed_forward[::-1]), tuple(recurrent[::-1]), fired, correct)


@dataclass(frozen=True)
class Answer:
    """What a stack did on a batch.

    output: (sample, step, class) uint8, shift included.
    spikes: (sample, step, layer) int32, layer 0 = the input rows.
    updates: (sample, step, layer - 1) int32.
    fired: per layer, (neuron,) spikes over the batch.
    peak: largest |u| or |v| over all layers, weight units.
    """

    output: Array
    spikes: Array
    updates: Array
    fired: tuple[Array, ...]
    peak: float


def answer(rows: Rows, layers: Sequence[cpu.Weights], *, integer: bool) -> Answer:
    """Run a stack over a batch and count what it costs (arguments as in `gradients`)."""
    spikes, updates, fired = [rows.per_step()], [], []
    peak = 0.0
    for layer in layers:
        done = cpu.forward(rows, layer, integer=integer, count=True)
        spikes.append(done.fired.per_step())
        updates.append(done.updates)
        fired.append(np.bincount(done.fired.index, minlength=layer.n_neurons))
        peak = max(peak, done.peak)
        rows = cpu.delayed(done.fired)
    return Answer(cpu.dense(rows), np.stack(spikes, -1), np.stack(updates, -1), tuple(fired), peak)
