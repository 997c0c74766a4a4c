"""Plain torch loops over time steps with automatic differentiation: the slow, independent peer.

They share the equations with dse (same surrogate, reset ignored in the backward pass, straight-through
rounding) and nothing of its code, so they serve as a witness of gradients and as a baseline of speed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from dse.neurons.surrogate import Exponential

if TYPE_CHECKING:
    from dse.engine.layers import Weights


class Fire(torch.autograd.Function):
    """Step function forward, exponential surrogate backward."""

    @staticmethod
    def forward(ctx: Any, v: torch.Tensor, threshold: float, surrogate: Exponential) -> torch.Tensor:
        """Return 1 where v > threshold, else 0."""
        ctx.save_for_backward(v)
        ctx.surrogate = surrogate
        return (v > threshold).to(v.dtype)

    @staticmethod
    def backward(ctx: Any, *grad: torch.Tensor) -> Any:
        """Return the gradient times the surrogate of ds/dv."""
        (v,) = ctx.saved_tensors
        s = ctx.surrogate
        slope = (v - s.centre).abs_().mul_(-1 / s.width).exp_().mul_(s.height)
        return slope.mul_(grad[0]), None, None


class CsrProduct(torch.autograd.Function):
    """Spikes (row, input) in CSR times weights (input, neuron); the transpose serves the backward pass."""

    @staticmethod
    def forward(
        ctx: Any, weight: torch.Tensor, spikes: torch.Tensor, transposed: torch.Tensor
    ) -> torch.Tensor:
        """Return the weighted input spikes, (row, neuron)."""
        ctx.transposed = transposed
        return spikes @ weight

    @staticmethod
    def backward(ctx: Any, *grad: torch.Tensor) -> Any:
        """Return the gradient by the weights."""
        return ctx.transposed @ grad[0], None, None


def _truncated(x: torch.Tensor) -> torch.Tensor:
    """Truncate to 1/4096; the gradient passes straight through."""
    return x + (torch.trunc(x.detach() * 4096) / 4096 - x.detach())


def layer_spikes(
    drive: torch.Tensor,
    keep_current: torch.Tensor,
    keep_voltage: torch.Tensor,
    threshold: float,
    surrogate: Exponential,
    ring: torch.Tensor | None = None,
    integer: bool = False,
) -> torch.Tensor:
    """Return a layer's spikes before the one-step shift.

    Args:
        drive: weighted input spikes, (step, sample, neuron).
        keep_current: (neuron,) factor of the current from one step to the next.
        keep_voltage: (neuron,) factor of the potential.
        threshold: in weight units.
        surrogate: ds/dv.
        ring: recurrent weights (neuron, neuron), row = presynaptic.
        integer: truncate states to 1/4096, as integer arithmetic does.
    """
    u = torch.zeros_like(drive[0])
    v, s = torch.zeros_like(u), torch.zeros_like(u)
    spikes = []
    for z in drive.unbind(0):
        if ring is not None:
            z = z + s @ ring
        if integer:
            u = _truncated(u * keep_current) + _truncated(z)
            v = _truncated(v * keep_voltage) + u
        else:
            u = torch.addcmul(z, u, keep_current)
            v = torch.addcmul(u, v, keep_voltage)
        s = Fire.apply(v, threshold, surrogate)
        v = v - (v * s).detach()  # reset forward, invisible backward
        spikes.append(s)
    return torch.stack(spikes)


def later(spikes: torch.Tensor) -> torch.Tensor:
    """Return spikes (step, ...) one step later; the last step's are lost."""
    return torch.cat([torch.zeros_like(spikes[:1]), spikes[:-1]])


def spike_rate(
    output: torch.Tensor, labels: torch.Tensor, true_rate: float, false_rate: float
) -> torch.Tensor:
    """Return SLAYER's SpikeRate loss of output spikes (step, sample, class), summed over the batch."""
    rate = output.mean(0)
    target = torch.full_like(rate, false_rate)
    target[torch.arange(len(labels))[:, None], labels.reshape(len(labels), -1)] = true_rate
    return ((rate - target) ** 2).sum()


def gradients(
    x: np.ndarray,
    layers: Sequence[Weights],
    surrogates: Sequence[Exponential],
    labels: np.ndarray,
    true_rate: float,
    false_rate: float,
    integer: bool,
    gains: Sequence[np.ndarray | None],
    dtype: torch.dtype = torch.float64,
) -> tuple[float, list[np.ndarray], np.ndarray | None]:
    """Return the SpikeRate loss, dL/dW per layer and the first recurrent dL/dR, by autograd.

    Args:
        x: (sample, step, input) spikes.
        layers: weights, input side first.
        surrogates: ds/dv of each layer.
        labels: output neurons of the labels, (sample,) or (sample, head).
        true_rate: target rate of the label's output.
        false_rate: target rate of the other outputs.
        integer: truncate states to 1/4096.
        gains: per layer, (sample, input) factors of its input spikes, or None.
        dtype: in which to calculate.
    """

    def tensor(x: np.ndarray) -> torch.Tensor:
        return torch.as_tensor(x, dtype=dtype)

    weights = [tensor(layer.feed_forward).requires_grad_() for layer in layers]
    rings = [tensor(layer.recurrent).requires_grad_() if layer.recurrent.size else None for layer in layers]
    y = tensor(x).transpose(0, 1)
    for weight, ring, layer, surrogate, gain in zip(weights, rings, layers, surrogates, gains, strict=True):
        y = later(
            layer_spikes(
                (y if gain is None else y * tensor(gain)) @ weight,
                tensor(layer.keep_current),
                tensor(layer.keep_voltage),
                layer.threshold / 64,
                surrogate,
                ring,
                integer,
            )
        )
    loss = spike_rate(y, torch.as_tensor(labels), true_rate, false_rate)
    loss.backward()
    found = [w.grad.numpy() for w in weights if w.grad is not None]
    ring_grads = [r.grad.numpy() for r in rings if r is not None and r.grad is not None]
    return float(loss.detach()), found, ring_grads[0] if ring_grads else None
