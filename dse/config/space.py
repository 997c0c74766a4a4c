"""A search space: what is fixed, what is varied, and what a design of it means."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from dse.config.axes import Axis
from dse.config.sections import SECTIONS, ExecutionSettings
from dse.config.values import echo
from dse.config.yaml_lines import dump

Design = dict[str, Any]


@dataclass(frozen=True, eq=False)
class DecisionGrid:
    """Decision parameters to evaluate for every trained design.

    phi: (n_phi,) int64 spike offsets, rising.
    theta: (n_theta,) float64 confidences in [0, 1], rising.
    """

    phi: np.ndarray
    theta: np.ndarray


@dataclass(frozen=True)
class SearchSettings:
    """How designs are proposed and how often each is trained.

    sampler: name in section `search.samplers`; options: its own keys.
    n_trials: designs to train; None: the whole grid.
    batch: designs proposed at a time.
    repeats, repeats_on_front: trainings of every design, and of those on the front at the end.
    """

    sampler: str
    n_trials: int | None
    batch: int
    repeats: int
    repeats_on_front: int
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class SearchSpace:
    """One study: everything of its YAML file, validated, defaults filled in.

    source: the file it was read from; data files are looked up beside it.
    fixed: section -> key -> value, without the keys that are axes.
    axes: by dotted name, in the order of the sections.
    objectives: (column, 'max' or 'min').
    """

    study: str
    seed: int
    source: Path
    fixed: Mapping[str, Any]
    axes: Mapping[str, Axis]
    decision: DecisionGrid
    hardware: tuple[str, ...]
    objectives: tuple[tuple[str, str], ...]
    search: SearchSettings
    execution: ExecutionSettings

    def resolve(self, design: Mapping[str, Any]) -> dict[str, Any]:
        """Return the sections (data .. training) with a design's values in their places.

        Args:
            design: axis name -> value, one for every axis; a list of one may be written as its element.

        Raises:
            ValueError: an axis is missing, unknown, or the value is not on it.
        """
        if set(design) != set(self.axes):
            raise ValueError(f"a design must have the axes {sorted(self.axes)}, got {sorted(design)}")
        resolved: dict[str, Any] = copy.deepcopy(dict(self.fixed))
        for name, axis in self.axes.items():
            value = _frozen(design[name])
            if not axis.contains(value):
                raise ValueError(f"design: {name} must be on its axis {axis.to_plain()}, got {echo(value)}")
            *parents, key = name.split(".")
            inner = resolved
            for parent in parents:
                inner = inner.setdefault(parent, {})
            inner[key] = axis.wrapped(value)
        return resolved

    def to_plain(self) -> dict[str, Any]:
        """Return the whole search space as plain data, as a file with every default written would hold it."""
        sections: dict[str, Any] = copy.deepcopy(dict(self.fixed))
        for name, axis in self.axes.items():
            section, key = name.split(".", 1)
            sections.setdefault(section, {})[key] = axis.to_plain()
        sections["decision"] = {"phi": self.decision.phi.tolist(), "theta": self.decision.theta.tolist()}
        sections["hardware"] = list(self.hardware)
        sections["objectives"] = [f"{name}:{direction}" for name, direction in self.objectives]
        search = {name: value for name, value in vars(self.search).items() if name != "options"}
        sections["search"] = search | dict(self.search.options)
        sections["execution"] = dict(vars(self.execution))
        ordered = {name: sections[name] for name in SECTIONS if name in sections}
        return {"study": self.study, "seed": self.seed} | ordered

    def to_yaml(self) -> str:
        """Return the fully resolved file; reading it gives the same search space."""
        return dump(self.to_plain())


def _frozen(value: Any) -> Any:
    """Return lists as tuples: a design that went through JSON is the same design."""
    return tuple(map(_frozen, value)) if isinstance(value, list | tuple) else value
