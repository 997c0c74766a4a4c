"""What training minimises, and how many samples the outputs answer rightly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dse.base.records import Array
from dse.engine.losses import Loss, Outputs
from dse.engine.losses.spike_rate import SpikeRate

SPIKE_RATE: Loss = SpikeRate()
"""The loss where none is named."""


@dataclass(frozen=True)
class Goal:
    """What training minimises: a loss over output spikes, and what hidden spikes add to it.

    true_rate, false_rate: target spike rates of the label's output and of the others.
    heads: classes of each head, whose outputs lie side by side; empty: one head.
    hidden_spike_penalty: what each spike of a hidden neuron adds to the loss of its sample.
    """

    loss: Loss
    true_rate: float
    false_rate: float
    heads: tuple[int, ...] = ()
    hidden_spike_penalty: float = 0.0

    def outputs(self, labels: Array, n_steps: int, n_classes: int, soft: Array | None = None) -> Outputs:
        """Return what the outputs are to say.

        Args:
            labels: output neurons of the labels, (sample,), or (sample, head).
            n_steps: steps of a sample.
            n_classes: output neurons.
            soft: (sample, class) probabilities in place of the labels; None: the labels.
        """
        return Outputs(
            is_label(labels, n_classes) if soft is None else soft,
            self.loss.lengths(n_steps),
            self.heads or (n_classes,),
            self.true_rate,
            self.false_rate,
        )


def is_label(labels: Array, n_classes: int) -> Array:
    """Return 1 where an output stands for a label of the sample, else 0, (sample, class) float64."""
    marks = np.zeros((len(labels), n_classes))
    marks[np.arange(len(labels))[:, None], labels.reshape(len(labels), -1)] = 1
    return marks


def by_spike(by_count: Any) -> Any:
    """Return the gradient by an output spike between two lengths, from that by the counts up to each length.

    A spike counts at every length that it comes before.

    Args:
        by_count: (..., length, class), of numpy or torch; the result is like it.
    """
    if by_count.shape[-2] == 1:
        return by_count
    flip = np.flip if isinstance(by_count, np.ndarray) else lambda x, axis: x.flip(axis)
    return flip(flip(by_count, -2).cumsum(-2), -2)


def n_correct(counts: Array, labels: Array, heads: tuple[int, ...] = ()) -> int:
    """Return how many samples have the label as their most active output (the lowest on ties) in every head.

    Args:
        counts: (sample, class) output spikes.
        labels: output neurons of the labels, (sample,), or (sample, head) where the outputs serve several.
        heads: classes of each head, whose outputs lie side by side; empty: one head.
    """
    if not heads:
        return int((counts.argmax(axis=1) == labels).sum())
    ends = np.cumsum(heads)
    answers = [counts[:, end - n : end].argmax(axis=1) + end - n for n, end in zip(heads, ends, strict=True)]
    return int((np.stack(answers, axis=1) == labels).all(axis=1).sum())
