"""Scrambled Sobol points: designs that fill the space more evenly than random ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dse.base import seeds
from dse.base.registry import register
from dse.config.contracts import SamplerSettings
from dse.config.space import Design, SearchSpace
from dse.config.yaml_lines import Raw
from dse.search.proposals import Limited, Sampler, Values
from dse.search.space import at, design_at

# Points in a row that give no new design, after which the rest of a grid is proposed in its order.
_MOST_POINTS = 1024


@register("search.samplers", "sobol")
@dataclass(frozen=True)
class Sobol(SamplerSettings):
    """Points of a scrambled Sobol sequence, spread evenly over all axes; learns nothing from results.

    Source: Sobol 1967, scrambled as by Owen 1995; `scipy.stats.qmc` (REFERENCES.md).
    """

    def start(self, space: SearchSpace, directions: Sequence[str]) -> Sampler:
        """Return the sampler."""
        return _SobolSampler(space)


class _SobolSampler(Limited):
    def __init__(self, space: SearchSpace) -> None:
        from scipy.stats import qmc

        super().__init__()
        self._space = space
        seed = int(seeds.generator(space.seed, {}, "sampler").integers(2**31))
        rng = np.random.default_rng(seed)  # the sequence spawns generators, which a counter-based one cannot
        self._points = qmc.Sobol(max(1, len(space.axes)), scramble=True, rng=rng)
        self._known: set[str] = set()
        self._rest = 0

    def ask(self, n: int) -> list[Design]:
        self.refused = []
        designs: list[Design] = []
        idle = 0
        while len(designs) < n and idle < _MOST_POINTS:
            design = self._placed(self._points.random(1)[0])
            idle = 0 if self._takes(design, designs) else idle + 1
        total = self._space.n_designs or 0
        while len(designs) < n and self._rest < total:
            self._takes(design_at(self._space, self._rest), designs)
            self._rest += 1
        return designs

    def _takes(self, design: Design, designs: list[Design]) -> bool:
        """Append a design that is new and passes the check; return whether it does."""
        key = seeds.design_key(design)
        if key in self._known:
            return False
        self._known.add(key)
        if self._refuses(design):
            return False
        designs.append(design)
        return True

    def tell(self, designs: Sequence[Mapping[str, Raw]], values: Sequence[Values]) -> None:
        self._known.update(map(seeds.design_key, designs))

    def _placed(self, point: Sequence[float]) -> Design:
        """Return the design at a point of the unit cube; axes that it does not have use no coordinate."""
        axes = self._space.axes.values()
        values = {axis.name: at(axis, float(u)) for axis, u in zip(axes, point, strict=False)}
        shared = {name: values[name] for name, axis in self._space.axes.items() if axis.condition is None}
        return {name: values[name] for name in self._space.active(shared)}
