"""The product's own torch path, dse.engine.autograd, as a peer of its kernels: loops over time steps.

The definition of the neuron runs on tensors, and automatic differentiation goes through it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import torch

from dse.engine.autograd import TorchCalculus, later, layer_spikes, loss_of, on_torch
from dse.engine.goal import SPIKE_RATE, Goal
from dse.engine.neurons import resonator
from dse.engine.neurons.cuba_lif import Population

if TYPE_CHECKING:
    from benchmarks import peers

__all__ = ["CsrProduct", "loops", "spike_rate"]


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


def spike_rate(
    output: torch.Tensor, labels: torch.Tensor, true_rate: float, false_rate: float
) -> torch.Tensor:
    """Return SLAYER's SpikeRate loss of output spikes (step, sample, class), summed over the batch."""
    return loss_of(output, labels.numpy(), Goal(SPIKE_RATE, true_rate, false_rate))


def loops(populations: Sequence[peers.Population]) -> list[Callable[[torch.Tensor], torch.Tensor]]:
    """Return each layer as a function of its weighted input, (step, sample, neuron) float32."""

    def loop(p: peers.Population) -> Callable[[torch.Tensor], torch.Tensor]:
        decays = (4096 * (1 - keep) for keep in (p.keep_u, p.keep_v))
        calculus = TorchCalculus("float32", p.surrogate)
        neurons = on_torch(Population(*decays, round(64 * p.threshold)), calculus)
        return lambda drive: later(layer_spikes(drive, neurons, calculus))

    return [loop(p) for p in populations]


def resonating(
    p: peers.Population, resonators: resonator.Population
) -> Callable[[torch.Tensor], torch.Tensor]:
    """Return a layer of resonators as a function of its weighted input, (step, sample, neuron) float32."""
    calculus = TorchCalculus("float32", p.surrogate)
    neurons = on_torch(resonators, calculus)
    return lambda drive: later(layer_spikes(drive, neurons, calculus))
