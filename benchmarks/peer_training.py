"""How a peer trains: Adam on batches, one at a time or through a design of a sweep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from benchmarks.peers import Peer, Population, peer
from benchmarks.torch_loop import spike_rate


def dense_inputs(x: np.ndarray) -> torch.Tensor:
    """Return spikes (sample, step, input) as (step, sample, input) float32."""
    return torch.as_tensor(x).transpose(0, 1).float().contiguous()


class Learner:
    """A peer with Adam, in plain weight units."""

    def __init__(self, network: Peer, true_rate: float, false_rate: float) -> None:
        self.network = network
        self._rates = true_rate, false_rate
        self._adam = torch.optim.Adam(network.weights)

    def step(self, inputs: Any, labels: torch.Tensor, learning_rate: float) -> None:
        """Train on a batch."""
        self._adam.param_groups[0]["lr"] = learning_rate
        self._adam.zero_grad(set_to_none=True)
        spike_rate(self.network.spikes(inputs)[-1], labels, *self._rates).backward()
        self._adam.step()

    @torch.no_grad()
    def answers(self, inputs: Any) -> torch.Tensor:
        """Return the most active output of each sample."""
        return self.network.spikes(inputs)[-1].mean(0).argmax(1)


@dataclass(frozen=True)
class TaskDesign:
    """One design of a sweep: its weights at start, and the learning rate of each (epoch, batch)."""

    weights: Sequence[np.ndarray]
    populations: Sequence[Population]
    true_rate: float
    false_rate: float
    learning_rates: np.ndarray


@dataclass(frozen=True)
class Task:
    """What designs of a sweep train on.

    x: (sample, step, input) spikes. target: (sample,) class numbers.
    order: (epoch, training sample) sample numbers. validation: sample numbers.
    """

    x: np.ndarray
    target: np.ndarray
    order: np.ndarray
    validation: np.ndarray
    batch_size: int
    designs: Mapping[int, TaskDesign]

    def network(self, name: str, number: int) -> Peer:
        """Return a design in a peer, as it starts."""
        design = self.designs[number]
        return peer(name, design.weights, design.populations)

    def train(self, name: str, number: int) -> float:
        """Train a design in a peer; return its validation accuracy."""
        design, network = self.designs[number], self.network(name, number)
        learner = Learner(network, design.true_rate, design.false_rate)
        for samples, rates in zip(self.order, design.learning_rates, strict=True):
            for batch, rate in enumerate(rates):
                part = samples[batch * self.batch_size : (batch + 1) * self.batch_size]
                labels = torch.as_tensor(self.target[part])
                learner.step(network.prepare(dense_inputs(self.x[part])), labels, float(rate))
        answers = learner.answers(network.prepare(dense_inputs(self.x[self.validation])))
        return float((answers.numpy() == self.target[self.validation]).mean())
