"""How a network is trained: the settings every trainable family shares."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dse.registry import param

if TYPE_CHECKING:
    from dse.models.snn.family import SNN

Generators = Callable[..., np.random.Generator]
"""`rngs(purpose, *index)`: the generator of one purpose of one design."""


class TrainingDiverged(RuntimeError):
    """Loss, gradient or weights are beyond use; the message names the epoch and the cause."""


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
    clip_norm: float | None = param(
        None, low=0, low_open=True, doc="a longer gradient is scaled down to this norm; absent: never"
    )
    silent_epochs: int = param(
        20,
        low=0,
        unit="epochs",
        doc="training ends where a layer was silent or saturated for so long; 0: never",
    )

    def rate(self, epoch: float) -> float:
        """Return the learning rate at a time in epochs (fractions count in the warm-up)."""
        rising = min(1.0, (epoch + 1e-3) / self.warmup_epochs) if self.warmup_epochs else 1.0
        return self.learning_rate * rising * self.lr_factor ** (int(epoch) // self.lr_every)


class Design(NamedTuple):
    """A design in a cohort: settings of the family, settings of its training, its own random generators."""

    model: SNN
    training: Training
    rngs: Generators
