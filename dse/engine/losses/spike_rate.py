"""SLAYER's SpikeRate loss: outputs are to fire at a high rate for their label, at a low one for others."""

from __future__ import annotations

from dataclasses import dataclass

from array_api_compat import array_namespace

from dse.base.records import Array
from dse.base.registry import register
from dse.engine.losses import Outputs


@register("losses", "spike_rate")
@dataclass(frozen=True)
class SpikeRate:
    """Squared distance of every output's spike rate from `true_rate` or `false_rate`.

        rate[n, c] = counts[n, c] / T;   L = sum over n, c of (rate - target)^2
        dL/dy[n, t, c] = (2 / T) (rate - target), constant in t

    Of a probability between 0 and 1, the target lies between the two rates. No factor 1/2, and a sum over
    the batch. Source: lava-dl `slayer.loss.SpikeRate` (REFERENCES.md).
    """

    def lengths(self, n_steps: int) -> tuple[int, ...]:
        """Return the whole input."""
        return (n_steps,)

    def value(self, counts: Array, outputs: Outputs) -> Array:
        """Return the summed squared distances."""
        xp = array_namespace(counts)
        none = xp.zeros_like(counts)
        is_label = none + outputs.is_label[..., None, :]
        between = outputs.false_rate + is_label * (outputs.true_rate - outputs.false_rate)
        target = xp.where(is_label == 1, none + outputs.true_rate, between)
        value: Array = xp.sum((counts / outputs.lengths[-1] - target) ** 2)
        return value

    def gradient(self, counts: Array, outputs: Outputs) -> tuple[Array, Array]:
        """Return them, and 2 / T times the distances."""
        n_steps, is_label = outputs.lengths[-1], outputs.is_label[..., None, :]
        error = counts / n_steps - outputs.false_rate + is_label * (outputs.false_rate - outputs.true_rate)
        return (error**2).sum(), 2 / n_steps * error
