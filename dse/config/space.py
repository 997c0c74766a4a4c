"""A search space: what is fixed, what is varied, and what a design of it means."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from dse.config.axes import Axis, Branching, branchings, n_combinations
from dse.config.sections import SECTIONS
from dse.config.settings import ExecutionSettings
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
class PrecisionSettings:
    """At which precisions trained designs on the front, and near it, are evaluated.

    weight_bits: rising, 2 to 8. pruned: rising shares in [0, 1).
    within: accuracy that a design may lie below the front.
    """

    weight_bits: tuple[int, ...]
    pruned: tuple[float, ...]
    within: float

    @property
    def settings(self) -> tuple[tuple[int, float], ...]:
        """Every (bits, pruned) but the one that is trained: 8 bits and nothing pruned."""
        return tuple((b, p) for b in self.weight_bits for p in self.pruned if (b, p) != (8, 0.0))


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
    axes: by dotted name, in the order of the sections; one with a condition follows the axis that it names.
    objectives: (column, 'max' or 'min').
    entries: section -> kind -> key -> value, for the sections that are a choice of several components.
    precision: None where trained networks are evaluated as they are.
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
    entries: Mapping[str, Mapping[str, Mapping[str, Any]]] = field(default_factory=dict)
    precision: PrecisionSettings | None = None

    @cached_property
    def branchings(self) -> list[Branching]:
        """Axes that every design has, each with those that only some of its values bring along."""
        return branchings(self.axes.values())

    @cached_property
    def n_designs(self) -> int | None:
        """Number of designs, or None where an axis is a range without steps."""
        return n_combinations(self.axes.values())

    def active(self, design: Mapping[str, Any]) -> dict[str, Axis]:
        """Return the axes that a design has, which follow from its values on the axes of kinds."""
        return {
            name: axis
            for name, axis in self.axes.items()
            if axis.condition is None or design.get(axis.condition[0]) == axis.condition[1]
        }

    def resolve(self, design: Mapping[str, Any]) -> dict[str, Any]:
        """Return the sections (data .. training) with a design's values in their places.

        Args:
            design: axis name -> value, one for every axis that its kinds have; a list of one may be written
                as its element.

        Raises:
            ValueError: an axis is missing, unknown, or the value is not on it.
        """
        axes = self.active(design)
        if set(design) != set(axes):
            raise ValueError(f"a design must have the axes {sorted(axes)}, got {sorted(design)}")
        values = {name: _frozen(design[name]) for name in axes}
        for name, axis in axes.items():
            if not axis.contains(values[name]):
                text = f"must be on its axis {axis.to_plain()}, got {echo(values[name])}"
                raise ValueError(f"design: {name} {text}")
        chosen = {section: kinds[values[f"{section}.kind"]] for section, kinds in self.entries.items()}
        resolved = _sections(self.fixed, chosen)
        for name, axis in axes.items():
            section, key = axis.place
            resolved.setdefault(section, {})[key] = axis.wrapped(values[name])
        return resolved

    def to_plain(self) -> dict[str, Any]:
        """Return the whole search space as plain data, as a file with every default written would hold it."""
        sections = _sections(self.fixed, self.entries)
        for name, axis in self.axes.items():
            section, key = axis.place
            if axis.condition is not None:
                sections[section][axis.condition[1]][key] = axis.to_plain()
            elif name != f"{section}.kind":
                sections.setdefault(section, {})[key] = axis.to_plain()
        sections |= {section: {"choice": list(sections[section].values())} for section in self.entries}
        sections["decision"] = {"phi": self.decision.phi.tolist(), "theta": self.decision.theta.tolist()}
        if self.precision is not None:
            sections["precision"] = dict(vars(self.precision))
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


def _sections(*parts: Mapping[str, Any]) -> dict[str, Any]:
    """Return copies of the sections of several mappings, in the order of a file."""
    found = {section: keys for part in parts for section, keys in part.items()}
    return {section: copy.deepcopy(found[section]) for section in SECTIONS if section in found}


def _frozen(value: Any) -> Any:
    """Return lists as tuples: a design that went through JSON is the same design."""
    return tuple(map(_frozen, value)) if isinstance(value, list | tuple) else value
