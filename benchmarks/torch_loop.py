"""A plain torch loop over time steps with automatic differentiation: the slow, independent peer.

It shares the equations with dse (same surrogate, reset ignored in the backward pass, straight-through
rounding) and nothing of its code, so it serves as a witness of gradients and as a baseline of speed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch

from dse.engine.layers import Weights
from dse.neurons.surrogate import Exponential


class _Fire(torch.autograd.Function):
    """Step function forward, exponential surrogate backward."""

    @staticmethod
    def forward(ctx: Any, v: torch.Tensor, threshold: float, surrogate: Exponential) -> torch.Tensor:
        ctx.save_for_backward(v)
        ctx.surrogate = surrogate
        return (v > threshold).to(v.dtype)

    @staticmethod
    def backward(ctx: Any, *grad: torch.Tensor) -> Any:
        (v,) = ctx.saved_tensors
        s = ctx.surrogate
        return grad[0] * s.height * torch.exp(-(v - s.centre).abs() / s.width), None, None


def _truncated(x: torch.Tensor, integer: bool) -> torch.Tensor:
    """Truncate to 1/4096 in integer arithmetic; the gradient passes straight through."""
    return x + (torch.trunc(x.detach() * 4096) / 4096 - x.detach()) if integer else x


def layer_output(
    x: torch.Tensor,
    weight: torch.Tensor,
    ring: torch.Tensor | None,
    layer: Weights,
    surrogate: Exponential,
    integer: bool,
) -> torch.Tensor:
    """Return a layer's spikes (sample, step, neuron) before the one-step shift."""
    keep_u = torch.as_tensor(layer.keep_current, dtype=x.dtype)
    keep_v = torch.as_tensor(layer.keep_voltage, dtype=x.dtype)
    drive = x @ weight
    u = torch.zeros_like(drive[:, 0])
    v, s = torch.zeros_like(u), torch.zeros_like(u)
    spikes = []
    for t in range(x.shape[1]):
        z = drive[:, t] if ring is None else drive[:, t] + s @ ring
        u = _truncated(u * keep_u, integer) + _truncated(z, integer)
        v = _truncated(v * keep_v, integer) + u
        s = _Fire.apply(v, layer.threshold / 64, surrogate)
        v = v + (v * (1 - s) - v).detach()  # reset forward, invisible backward
        spikes.append(s)
    return torch.stack(spikes, 1)


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
    """Return the SpikeRate loss, dL/dW per layer and the first recurrent dL/dR, by autograd."""
    weights = [torch.tensor(layer.feed_forward, dtype=dtype, requires_grad=True) for layer in layers]
    rings = [
        torch.tensor(layer.recurrent, dtype=dtype, requires_grad=True) if layer.recurrent.size else None
        for layer in layers
    ]
    y = torch.as_tensor(x, dtype=dtype)
    for weight, ring, layer, surrogate, gain in zip(weights, rings, layers, surrogates, gains, strict=True):
        if gain is not None:
            y = y * torch.as_tensor(gain, dtype=dtype)[:, None]
        spikes = layer_output(y, weight, ring, layer, surrogate, integer)
        y = torch.cat([torch.zeros_like(spikes[:, :1]), spikes[:, :-1]], 1)
    target = torch.full(y.shape[::2], false_rate, dtype=dtype)
    target[torch.arange(len(labels)), torch.as_tensor(labels)] = true_rate
    loss = ((y.mean(1) - target) ** 2).sum()
    loss.backward()
    found = [w.grad.numpy() for w in weights if w.grad is not None]
    ring_grads = [r.grad.numpy() for r in rings if r is not None and r.grad is not None]
    return float(loss.detach()), found, ring_grads[0] if ring_grads else None
