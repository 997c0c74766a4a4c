"""How a network is trained: the settings every trainable family shares."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from dse.config.contracts import Generators
from dse.config.settings import Training

if TYPE_CHECKING:
    from dse.models.snn.family import SNN

__all__ = ["Design", "Generators", "Training", "TrainingDiverged"]


class TrainingDiverged(RuntimeError):
    """Loss, gradient or weights are beyond use; the message names the epoch and the cause."""


class Design(NamedTuple):
    """A design in a cohort: settings of the family, settings of its training, its own random generators."""

    model: SNN
    training: Training
    rngs: Generators
