"""What is known of a design before it is trained, and which designs are therefore never trained.

Size, memory and cores of a spiking network follow from its design and the shape of its data; costs have lower
bounds: those of the earliest answer that a design point can give, without a spike. Limits concern networks as
they are trained; other precisions (section `precision`) are not considered. A design is excluded if no design
point of it can meet all limits on any one chip.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from dse.base import registry
from dse.base.records import Operations
from dse.config import SearchSpace
from dse.config.contracts import LeastWork, placed, trains_in_cohorts
from dse.config.expressions import named_columns
from dse.config.resolved import Sections
from dse.config.yaml_lines import Raw
from dse.data.dataset.shape import Shape
from dse.measure.hardware.profile import Profile
from dse.measure.objectives.work import memory_bytes
from dse.measure.on_chips import columns_on
from dse.measure.run import read_out_steps
from dse.search.limits import MISSING, Exclusion, Known, Row, can_meet, exclusion
from dse.study.record import RunRecord
from dse.study.trials import summary

_SIZING = ("data", "task", "window", "preprocessing", "encoder", "model")


class KnownBefore:
    """What is known of the designs of a search space before they are trained.

    shape_of: returns the shape of a design's data set; None where it is not known.
    """

    def __init__(
        self, space: SearchSpace, profiles: Sequence[Profile], shape_of: Callable[[Sections], Shape | None]
    ) -> None:
        self._space = space
        self._limits = space.limits or ()
        self._profiles = {profile.name: profile for profile in profiles}
        self._shape_of = shape_of
        self._of_size: dict[tuple[object, ...], dict[str, Row]] = {}
        self._sizing = [name for name, axis in space.axes.items() if axis.place[0] in _SIZING]
        measured = registry.columns()
        self.needs_data = any(name in measured for name in named_columns(self._limits))

    def exclusion(self, design: Mapping[str, Raw]) -> Exclusion | None:
        """Return why a design cannot meet the limits, None if it can."""
        if not self._limits:
            return None
        return exclusion(self._limits, self._rows(design, needs_data=self.needs_data))

    def meets(self, design: Mapping[str, Raw], records: Sequence[RunRecord]) -> bool:
        """Return whether a trained design meets the limits at its full read-out, on some chip."""
        numbers, cells = [record.last for record in records], self._cells(design)
        of_chip = dict.fromkeys(registry.columns("hardware"), MISSING)
        for chip in self._profiles or (None,):
            columns = summary(numbers, chip if chip in numbers[0].hardware else None)
            row = cells | of_chip | {name: _number(x) for name, x in columns.items()}
            if all(can_meet(limit, row) for limit in self._limits):
                return True
        return False

    def _cells(self, design: Mapping[str, Raw]) -> dict[str, Known]:
        task, family = self._space.task_name(design), self._space.kind("model", design)
        has_encoder = "encoder" in self._space.parts
        encoder = self._space.kind("encoder", design) if has_encoder else "none"
        cells: dict[str, Known] = {"task": task, "family": family, "encoder": encoder}
        for name, axis in self._space.axes.items():
            cells[name] = MISSING if name not in design else _number(axis.cell(design[name]))
        return cells

    def _rows(self, design: Mapping[str, Raw], *, needs_data: bool) -> dict[str, Row]:
        """Return chip, '' without one -> what is known of a design there."""
        cells = self._cells(design)
        if not needs_data:
            return {"": cells}
        key = tuple(repr(design.get(name)) for name in self._sizing)
        if key not in self._of_size:
            sections = self._space.resolve(design)
            self._of_size[key] = self._sized(sections, self._shape_of(sections))
        return {place: {**cells, **row} for place, row in self._of_size[key].items()}

    def _sized(self, sections: Sections, shape: Shape | None) -> dict[str, Row]:
        """Return chip, '' without one -> what follows from the size of a network."""
        unknown: dict[str, Row] = {chip: {} for chip in self._profiles or ("",)}
        model = sections.model
        if shape is None or not trains_in_cohorts(model):
            return unknown
        sizes = placed(model, shape.positions)
        n_channels, n_outputs = len(shape.positions), shape.n_outputs
        least: LeastWork | None = None
        if hasattr(sizes, "least_work"):
            steps = self._least_steps(shape, model.steps_per_sample)
            least = sizes.least_work(n_channels, n_outputs, shape.step_ms, steps)
        pruned = bool(getattr(model, "pruned", 0.0))
        n_weights = sizes.n_weights(n_channels, n_outputs)
        if least is None:  # what such a family stores may be less
            return {chip: {"n_weights": (0.0, n_weights)} for chip in unknown}
        row: dict[str, Known] = {"n_weights": (0.0 if pruned else n_weights, n_weights)}
        load = least.load
        stored = 0 if pruned else n_weights
        low = float(memory_bytes(np.asarray(stored), np.asarray(load.number_bits)))
        row["memory_bytes"] = (low, low if least.is_exact else math.inf)
        duration_ms = load.duration_ms if isinstance(load, Operations) else load.n_steps * load.step_ms
        row["decision_latency_ms"] = (float(duration_ms), math.inf)
        return {chip: {**row, **self._on(chip, least)} for chip in unknown}

    def _least_steps(self, shape: Shape, steps_per_sample: int) -> int:
        """Return the network steps of the earliest answer: a read-out, or a decision after phi spikes."""
        if shape.n_steps is None:
            return 1
        decision = self._space.decision
        n_steps = shape.n_steps * steps_per_sample
        first = int(read_out_steps(n_steps, shape.step_ms / steps_per_sample, decision.read_out_every_ms)[0])
        if decision.phi_step is None and (not decision.phi.size or not decision.theta.size):
            return first
        phi = 0 if decision.phi_step is not None else int(decision.phi[0])
        return max(1, min(first, -(-(phi + 1) // shape.n_outputs)))

    def _on(self, chip: str, least: LeastWork) -> Row:
        """Return what is known on a chip; columns that the chip does not have are missing."""
        if not chip:
            return {}
        declared = registry.columns("hardware")
        columns = columns_on(self._profiles[chip], least.load)
        row: dict[str, Known] = {}
        for name, column in declared.items():
            if not column.known:
                continue
            value = float(columns[name]) if name in columns else math.nan
            if math.isnan(value) or (column.known == "exact" and least.is_exact):
                row[name] = (value, value)
            else:
                row[name] = (value, math.inf) if column.direction == "min" else (0.0, value)
        # Where waiting draws more power than computing, less work may cost more: time alone bounds it.
        for end in ("", "_low", "_high"):
            row[f"energy_throttled_uj{end}"] = row[f"energy_uj{end}"]
        return row


def _number(value: object) -> Known:
    """Return a cell of a table as what is known: a text, or a number twice."""
    if isinstance(value, str):
        return value
    number = math.nan if value is None else float(value)  # type: ignore[arg-type]
    return number, number
