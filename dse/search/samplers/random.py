"""Independent uniform draws (Optuna's RandomSampler): the yardstick for the other samplers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dse.base.registry import register
from dse.config.contracts import SamplerSettings
from dse.config.space import SearchSpace
from dse.search.proposals import OptunaSampler, Sampler


@register("search.samplers", "random")
@dataclass(frozen=True)
class Random(SamplerSettings):
    """Independent uniform draws from every axis."""

    def start(self, space: SearchSpace, directions: Sequence[str]) -> Sampler:
        """Return the sampler."""
        import optuna

        return OptunaSampler(space, directions, lambda seed: optuna.samplers.RandomSampler(seed=seed))
