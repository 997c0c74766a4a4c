"""A search space: what is fixed, what is varied, and what a design of it means."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import cast

import numpy as np

from dse.base.registry import Plugin
from dse.config.axes import Axis, Branching, branchings, n_combinations
from dse.config.contracts import Source
from dse.config.parts import Part, target_name
from dse.config.resolved import SECTIONS, Sections
from dse.config.search import Search
from dse.config.settings import Evaluation, ExecutionSettings, Precision, Reach, Schedule, Split
from dse.config.values import Values, echo, plain
from dse.config.yaml_lines import Raw, dump

Design = dict[str, Raw]


@dataclass(frozen=True, eq=False)
class DecisionGrid:
    """Decision parameters to evaluate for every trained design.

    phi: (n_phi,) int64 spike offsets, rising; empty where `phi_step` is set.
    theta: (n_theta,) float64 confidences in [0, 1], rising.
    phi_step: distance of spike offsets from 0 up to what the outputs of a run's training samples reach.
    read_out_every_ms: distance of the read-outs of spiking networks; None: the usual number of them.
    """

    phi: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    theta: np.ndarray = field(default_factory=lambda: np.zeros(0))
    phi_step: int | None = None
    read_out_every_ms: float | None = None

    @classmethod
    def of(cls, part: Part) -> DecisionGrid:
        """Return the grid of section `decision`."""
        phi, theta = part.range("phi"), part.range("theta")
        step = phi[0].step if isinstance(phi[0], Reach) else None
        return cls(
            phi=np.unique(np.asarray(phi if step is None else (), dtype=np.int64)),
            theta=np.unique(np.asarray(theta, dtype=np.float64)),
            phi_step=step,
            read_out_every_ms=part.values["read_out_every_ms"],
        )

    def to_plain(self) -> dict[str, Raw]:
        """Return the parameters as they are written in YAML; keys that are not set are left out."""
        phi: Raw = self.phi.tolist()
        if self.phi_step is not None:
            phi = {"up_to": "outputs", "step": self.phi_step}
        every_ms: Raw = self.read_out_every_ms
        rest = {} if every_ms is None else {"read_out_every_ms": every_ms}
        return {"phi": phi, "theta": self.theta.tolist(), **rest}


@dataclass(frozen=True, eq=False, kw_only=True)
class SearchSpace:
    """One study: everything of its YAML file, validated, defaults filled in.

    source: the file it was read from; data files are looked up beside it.
    parts: section (data .. training) -> what is written there.
    axes: by dotted name, in the order of the sections; one with a condition follows the axis that it names.
    targets: names of targets that designs are to be exported to.
    limits: conditions that every design must be able to meet (`dse.search.limits`); None: not stated, and no
        design is excluded before it is trained.
    objectives: (column, 'max' or 'min').
    precision: None where trained networks are evaluated as they are.
    schedule: on which chips are priced; None: an inference at a time.
    plugins: modules of components outside `dse`, which are loaded.
    """

    study: str
    seed: int
    source: Path
    parts: Mapping[str, Part]
    axes: Mapping[str, Axis]
    decision: DecisionGrid
    hardware: tuple[str, ...]
    objectives: tuple[tuple[str, str], ...]
    search: Search
    execution: ExecutionSettings
    precision: Precision | None = None
    schedule: Schedule | None = None
    plugins: tuple[Plugin, ...] = ()
    targets: tuple[str, ...] = ()
    limits: tuple[str, ...] | None = None

    @cached_property
    def branchings(self) -> list[Branching]:
        """Axes that every design has, each with those that only some of its values bring along."""
        return branchings(self.axes.values())

    @cached_property
    def n_designs(self) -> int | None:
        """Number of designs, or None where an axis is a range without steps."""
        return n_combinations(self.axes.values())

    @property
    def data(self) -> Source:
        """The recordings, which all designs share."""
        return cast(Source, self.parts["data"].fixed)

    @property
    def evaluation(self) -> Evaluation | None:
        """What else every design is tested on; None: nothing."""
        part = self.parts.get("evaluation")
        return None if part is None else cast(Evaluation, part.fixed)

    @property
    def split(self) -> Split:
        """How the recordings are divided, in every design."""
        return cast(Split, self.parts["split"].fixed)

    @property
    def choices(self) -> dict[str, tuple[str, ...]]:
        """Section -> names of its components, for the sections that are a choice of several."""
        return {name: tuple(part.entries) for name, part in self.parts.items() if part.entries}

    def kind(self, section: str, design: Mapping[str, Raw]) -> str:
        """Return the name of the component that a section has in a design."""
        return self.parts[section].kind or str(design[f"{section}.kind"])

    def task_name(self, design: Mapping[str, Raw]) -> str:
        """Return what a design predicts: the task's name, or the columns of a target that is an axis."""
        values = self.parts["task"].values
        if "task.target" not in self.axes:
            return str(values["name"])
        return target_name(design["task.target"], joint=values["joint"])

    def active(self, design: Mapping[str, Raw]) -> dict[str, Axis]:
        """Return the axes that a design has, which follow from its values on the axes of kinds."""
        return {name: axis for name, axis in self.axes.items() if axis.is_in(design)}

    def resolve(self, design: Mapping[str, Raw]) -> Sections:
        """Return the sections of a design.

        Args:
            design: axis name -> value, one for every axis that its kinds have; a list of one may be written
                as its element.

        Raises:
            ValueError: an axis is missing, unknown, or the value is not on it; or a component refuses values
                that are legal one by one.
        """
        axes = self.active(design)
        if set(design) != set(axes):
            raise ValueError(f"a design must have the axes {sorted(axes)}, got {sorted(design)}")
        varied: dict[str, Values] = {}
        for name, axis in axes.items():
            value = plain(design[name])  # lists in a design that went through JSON
            if not axis.contains(value):
                text = f"must be on its axis {axis.to_plain()}, got {echo(value)}"
                raise ValueError(f"design: {name} {text}")
            section, key = axis.place
            varied.setdefault(section, {})[key] = axis.wrapped(value)
        objects: Values = {}
        kinds: dict[str, str] = {}
        for name, part in self.parts.items():
            values = varied.get(name, {})
            one = part.entries[values.pop("kind")] if part.entries else part
            if name == "test":
                objects[name] = self.parts["data"].built(one.values) if one.values else None
            else:
                objects[name] = one.built(values)
            if one.kind:
                kinds[name] = one.kind
        return Sections(kinds=kinds, **objects)

    def to_plain(self) -> dict[str, Raw]:
        """Return the whole search space as plain data, as a file with every default written would hold it."""
        sections: dict[str, Raw] = {}
        for name, part in self.parts.items():
            entries = [entry.to_plain() for entry in part.entries.values()]
            sections[name] = {"choice": entries} if entries else part.to_plain()
        sections["decision"] = self.decision.to_plain()
        if self.precision is not None:
            sections["precision"] = plain(self.precision)
        if self.schedule is not None:
            sections["schedule"] = {k: x for k, x in plain(self.schedule).items() if x is not None}
        sections["hardware"] = list(self.hardware)
        if self.targets:
            sections["targets"] = list(self.targets)
        sections["objectives"] = [f"{name}:{direction}" for name, direction in self.objectives]
        if self.limits is not None:
            sections["limits"] = list(self.limits)
        sections["search"] = self.search.to_plain()
        sections["execution"] = plain(self.execution)
        ordered = {name: sections[name] for name in SECTIONS if name in sections}
        about: dict[str, Raw] = {"study": self.study, "seed": self.seed}
        if self.plugins:
            about["plugins"] = [plugin.source for plugin in self.plugins]
        return about | ordered

    def to_yaml(self) -> str:
        """Return the fully resolved file; reading it gives the same search space."""
        return dump(self.to_plain())
