"""Every design in turn: the last axis changes fastest."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence

from dse.base.registry import register
from dse.config.contracts import SamplerSettings
from dse.config.parts import KeyFault, Part, Written
from dse.config.space import Design, SearchSpace
from dse.config.yaml_lines import Raw
from dse.search.proposals import Limited, Sampler, Values
from dse.search.space import design_at, index_of


@register("search.samplers", "grid")
@dataclasses.dataclass(frozen=True)
class Grid(SamplerSettings):
    """Every combination of the axes' values, in order; ranges need a step.

    Where time may end the search, families take turns first: what is cheap to train, such as the classifiers
    that `dse init` puts before networks, is then in the tables with every encoder.
    """

    @classmethod
    def faults(cls, part: Part, space: Written) -> Iterator[KeyFault]:
        """Yield the ranges without steps."""
        for axis in space.axes.values():
            if axis.values is None:
                text = f"needs a step or a choice for the grid sampler, got {axis.to_plain()}"
                yield (*axis.name.split("."), "range"), f"{axis.name} {text}"

    def start(self, space: SearchSpace, directions: Sequence[str]) -> Sampler:
        """Return the sampler.

        Raises:
            ValueError: an axis is a range without steps.
        """
        return _GridSampler(space)


class _GridSampler(Limited):
    def __init__(self, space: SearchSpace) -> None:
        super().__init__()
        total = space.n_designs
        if total is None:
            raise ValueError(
                "the grid sampler needs axes with a choice or a step, got a range without a step"
            )
        self._space, self._names = space, [*space.axes]
        if space.search.stop is not None:
            axes = dict(sorted(space.axes.items(), key=lambda item: item[1].place[0] != "model"))
            self._space = dataclasses.replace(space, axes=axes)
        self._total = total
        self._next = 0
        self._proposed: set[int] = set()

    def ask(self, n: int) -> list[Design]:
        designs: list[Design] = []
        self.refused = []
        while len(designs) < n and self._next < self._total:
            if self._next not in self._proposed:
                self._proposed.add(self._next)
                of_place = design_at(self._space, self._next)
                design = {name: of_place[name] for name in self._names if name in of_place}
                if not self._refuses(design):
                    designs.append(design)
            self._next += 1
        return designs

    def tell(self, designs: Sequence[Mapping[str, Raw]], values: Sequence[Values]) -> None:
        self._proposed.update(index_of(self._space, design) for design in designs)
