"""Tree-structured Parzen estimator (Optuna's TPESampler), for one or more objectives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dse.base.registry import fixed, register
from dse.config.contracts import SamplerSettings
from dse.config.space import SearchSpace
from dse.search.proposals import OptunaSampler, Sampler


@register("search.samplers", "tpe")
@dataclass(frozen=True)
class Tpe(SamplerSettings):
    """Tree-structured Parzen estimator; the robust choice for 25 designs and more."""

    startup: int = fixed(10, doc="number of random designs before the model is used", low=1)

    def start(self, space: SearchSpace, directions: Sequence[str]) -> Sampler:
        """Return the sampler; designs of one batch are spread by counting those asked as bad ones.

        With axes that only some designs have, each group of axes that occur together has a joint density.
        """
        import optuna

        conditional = any(axis.condition is not None for axis in space.axes.values())

        def make(seed: int) -> optuna.samplers.BaseSampler:
            return optuna.samplers.TPESampler(
                n_startup_trials=self.startup,
                constant_liar=True,
                seed=seed,
                multivariate=True if conditional else None,
                group=conditional,
            )

        return OptunaSampler(space, directions, make)
