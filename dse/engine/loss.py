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
        labels: (sample,) class numbers.
        true_rate: target rate of the label's neuron.
        false_rate: target rate of the others.

    Returns:
        The loss, and the gradient per sample and class (sample, class) float64 (the same at every step).
    """
    error = counts / n_steps - false_rate
    error[np.arange(len(labels)), labels] += false_rate - true_rate
    return float((error**2).sum()), 2 / n_steps * error
