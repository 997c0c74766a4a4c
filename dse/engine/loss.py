"""Losses over output spikes."""

from __future__ import annotations

import numpy as np

from dse.records import Array


def spike_rate(
    counts: Array, n_steps: int, labels: Array, true_rate: float, false_rate: float
) -> tuple[float, Array]:
    """Return SLAYER's SpikeRate loss and its gradient by the output spikes.

        rate[n, c] = counts[n, c] / T;   L = sum over n, c of (rate - target)^2
        dL/dy[n, t, c] = (2 / T) (rate - target), constant in t

    No factor 1/2, and a sum over the batch. Source: lava-dl `slayer.loss.SpikeRate` (REFERENCES.md).

    Args:
        counts: (sample, class) output spikes over all steps, one-step shift included.
        n_steps: T.
        labels: output neurons of the labels, (sample,), or (sample, head) where the outputs serve several.
        true_rate: target rate of a label's neuron.
        false_rate: target rate of the others.

    Returns:
        The loss, and the gradient per sample and class (sample, class) float64 (the same at every step).
    """
    error = counts / n_steps - false_rate
    of_head = labels[:, None] if labels.ndim == 1 else labels
    error[np.arange(len(labels))[:, None], of_head] += false_rate - true_rate
    return float((error**2).sum()), 2 / n_steps * error


def n_correct(counts: Array, labels: Array, heads: tuple[int, ...] = ()) -> int:
    """Return how many samples have the label as their most active output (the lowest on ties) in every head.

    Args:
        counts: (sample, class) output spikes.
        labels: as in `spike_rate`.
        heads: classes of each head, whose outputs lie side by side; empty: one head.
    """
    if not heads:
        return int((counts.argmax(axis=1) == labels).sum())
    ends = np.cumsum(heads)
    answers = [counts[:, end - n : end].argmax(axis=1) + end - n for n, end in zip(heads, ends, strict=True)]
    return int((np.stack(answers, axis=1) == labels).all(axis=1).sum())
