"""Cross-entropy on output spike counts: the label's neuron is to fire more often than the others."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from array_api_compat import array_namespace

from dse.base.records import Array
from dse.base.registry import param, register
from dse.engine.losses import Outputs


@register("losses", "count_cross_entropy")
@dataclass(frozen=True)
class CountCrossEntropy:
    """Cross-entropy of a softmax over output spike counts, summed over heads.

        p = softmax(k n);   L = -log p[label];   dL/dn[c] = k (p[c] - [c = label]),   k = count_scale

    Where probabilities q stand for the label, L = -sum q log p and dL/dn = k (p - q).
    With several read-outs, n are the counts after evenly spaced lengths of the input, and L is the mean over
    them: an early spike counts in more of them than a late one. `true_rate` and `false_rate` only set how
    often the outputs fire before training.
    """

    count_scale: float = param(
        0.15, low=0, low_open=True, doc="a spike more multiplies the odds of its class by exp(count_scale)"
    )
    read_outs: int = param(
        1, low=1, doc="the loss is the mean over this many evenly spaced lengths of the input"
    )

    def lengths(self, n_steps: int) -> tuple[int, ...]:
        """Return multiples of T / read_outs, rounded up; each length once."""
        n = self.read_outs
        return tuple(dict.fromkeys(-(-n_steps * k // n) for k in range(1, n + 1)))

    def value(self, counts: Array, outputs: Outputs) -> Array:
        """Return the cross-entropy; log-sum-exp keeps it finite for any counts."""
        xp = array_namespace(counts)
        entropies = []
        for of_head in _heads(outputs):
            logits = self.count_scale * counts[..., of_head]
            highest = xp.max(logits, axis=-1, keepdims=True)
            log_sum = highest[..., 0] + xp.log(xp.sum(xp.exp(logits - highest), axis=-1))
            of_label = xp.sum(outputs.is_label[..., None, of_head] * logits, axis=-1)
            entropies.append(xp.sum(log_sum - of_label))
        value: Array = sum(entropies[1:], entropies[0]) / len(outputs.lengths)
        return value

    def gradient(self, counts: Array, outputs: Outputs) -> tuple[Array, Array]:
        """Return it, and the scaled distances of the softmax from the labels."""
        xp = array_namespace(counts)
        factor, parts = self.count_scale / len(outputs.lengths), []
        for of_head in _heads(outputs):
            logits = self.count_scale * counts[..., of_head]
            powers = xp.exp(logits - xp.max(logits, axis=-1, keepdims=True))
            p = powers / xp.sum(powers, axis=-1, keepdims=True)
            parts.append(factor * (p - outputs.is_label[..., None, of_head]))
        return self.value(counts, outputs), xp.concat(parts, axis=-1)


def _heads(outputs: Outputs) -> Iterator[slice]:
    """Yield where the neurons of each head lie."""
    first = 0
    for n in outputs.heads:
        yield slice(first, first + n)
        first += n
