"""NSGA-II (Optuna's NSGAIISampler): evolution by non-dominated sorting."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dse.base.registry import fixed, register
from dse.config.contracts import SamplerSettings
from dse.config.space import SearchSpace
from dse.search.proposals import OptunaSampler, Sampler


@register("search.samplers", "nsga2")
@dataclass(frozen=True)
class Nsga2(SamplerSettings):
    """Non-dominated sorting genetic algorithm II; cheap, for hundreds of designs."""

    population: int = fixed(20, doc="designs per generation", low=2)

    def start(self, space: SearchSpace, directions: Sequence[str]) -> Sampler:
        """Return the sampler."""
        import optuna

        def make(seed: int) -> optuna.samplers.BaseSampler:
            return optuna.samplers.NSGAIISampler(population_size=self.population, seed=seed)

        return OptunaSampler(space, directions, make, replay=space.search.batch)
