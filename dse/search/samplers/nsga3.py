"""NSGA-III (Optuna's NSGAIIISampler): evolution towards reference points, for many objectives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dse.base.registry import fixed, register
from dse.config.contracts import SamplerSettings
from dse.config.space import SearchSpace
from dse.search.proposals import OptunaSampler, Sampler


@register("search.samplers", "nsga3")
@dataclass(frozen=True)
class Nsga3(SamplerSettings):
    """Non-dominated sorting genetic algorithm III; as nsga2, for three objectives and more.

    Source: Deb and Jain 2014 (REFERENCES.md).
    """

    population: int = fixed(20, doc="designs per generation", low=2)

    def start(self, space: SearchSpace, directions: Sequence[str]) -> Sampler:
        """Return the sampler."""
        import optuna

        def make(seed: int) -> optuna.samplers.BaseSampler:
            return optuna.samplers.NSGAIIISampler(population_size=self.population, seed=seed)

        return OptunaSampler(space, directions, make, replay=space.search.batch)
