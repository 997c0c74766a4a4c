"""Gaussian process with expected hypervolume improvement (Optuna's GPSampler)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from dse.base.registry import fixed, register
from dse.config.contracts import SamplerSettings
from dse.config.space import SearchSpace
from dse.search.proposals import OptunaSampler, Sampler


@register("search.samplers", "gp")
@dataclass(frozen=True)
class Gp(SamplerSettings):
    """Gaussian process; for few, expensive designs on smooth axes, at about a second per design."""

    # Its kernel compares designs on all axes, so a design that lacks one has no place.
    conditional: ClassVar[bool] = False
    requires: ClassVar[str] = "torch"

    startup: int = fixed(10, doc="number of random designs before the model is used", low=1)

    def start(self, space: SearchSpace, directions: Sequence[str]) -> Sampler:
        """Return the sampler."""
        import optuna

        def make(seed: int) -> optuna.samplers.BaseSampler:
            return optuna.samplers.GPSampler(
                n_startup_trials=self.startup, deterministic_objective=False, seed=seed
            )

        return OptunaSampler(space, directions, make)
