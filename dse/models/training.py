"""How a network is trained: what every trainable family shares."""

from __future__ import annotations

from dse.config.contracts import FitRequest, Generators
from dse.config.settings import Training

__all__ = ["FitRequest", "Generators", "Training", "TrainingDiverged"]


class TrainingDiverged(RuntimeError):
    """Loss, gradient or weights are beyond use; the message names the epoch and the cause."""
