"""How a network is trained: the settings every trainable family shares, and Adam."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dse.records import Array
from dse.registry import param

Generators = Callable[..., np.random.Generator]
"""`rngs(purpose, *index)`: the generator of one purpose of one design."""


class TrainingDiverged(RuntimeError):
    """The loss or a weight became NaN or infinite; the message names the epoch and the cause."""


@dataclass(frozen=True)
class Training:
    """Adam with a stepped schedule; every default is a published or a measured value."""

    epochs: int = param(60, low=1, doc="passes over the training samples")
    batch_size: int = param(32, low=1, doc="samples per weight update; an epoch's last batch may be smaller")
    learning_rate: float = param(0.03, low=0, low_open=True, doc="Adam's step size in units of `step_unit`")
    step_unit: str = param(
        "initial",
        choices=("initial", "weight"),
        doc="initial: each neuron's root mean square weight at start; weight: plain weight units, as SLAYER",
    )
    warmup_epochs: float = param(0.0, low=0, unit="epochs", doc="the learning rate rises from 0 meanwhile")
    lr_factor: float = param(0.67, low=0, low_open=True, high=1, doc="learning rate factor at each step")
    lr_every: int = param(20, low=1, unit="epochs", doc="epochs between steps of the learning rate")
    average_epochs: int = param(1, low=1, unit="epochs", doc="weights are the mean over the last epochs")
    dropout: float = param(
        0.1, low=0, high=1, high_open=True, doc="share of hidden neurons silenced per sample"
    )

    def rate(self, epoch: float) -> float:
        """Return the learning rate at a time in epochs (fractions count in the warm-up)."""
        rising = min(1.0, (epoch + 1e-3) / self.warmup_epochs) if self.warmup_epochs else 1.0
        return self.learning_rate * rising * self.lr_factor ** (int(epoch) // self.lr_every)


@dataclass
class Adam:
    """Adam in place (Kingma and Ba 2015, REFERENCES.md): moments per array, bias corrected."""

    first: list[Array]
    second: list[Array]
    steps: int = 0
    beta_1: float = 0.9
    beta_2: float = 0.999
    epsilon: float = 1e-8

    @classmethod
    def start(cls, weights: list[Array]) -> Adam:
        """Return zero moments for float32 arrays of the weights' shapes."""
        return cls([np.zeros_like(w) for w in weights], [np.zeros_like(w) for w in weights])

    def update(self, weights: list[Array], gradients: list[Array], learning_rates: list[Array]) -> None:
        """Move the weights against their gradients, in place."""
        self.steps += 1
        correction = 1 / (1 - self.beta_2**self.steps)
        for w, g, m, v, rate in zip(weights, gradients, self.first, self.second, learning_rates, strict=True):
            size = rate / (1 - self.beta_1**self.steps)
            m += (1 - self.beta_1) * (g - m)
            v += (1 - self.beta_2) * (g * g - v)
            w -= (size * m / (np.sqrt(v * correction) + self.epsilon)).astype(np.float32)
