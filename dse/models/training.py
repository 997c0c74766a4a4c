"""What families train with: settings, random generators, requests of a cohort; and how training fails."""

from __future__ import annotations

from dse.config.contracts import FitRequest, Generators, Rung, Span
from dse.config.settings import Training

__all__ = ["FitRequest", "Generators", "Rung", "Span", "Training", "TrainingDiverged"]


class TrainingDiverged(RuntimeError):
    """Loss, gradient or weights are beyond use; the message names the epoch and the cause."""
