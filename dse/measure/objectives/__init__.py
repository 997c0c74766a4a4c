"""Objectives: a file each, with the columns that it measures and the function that measures them.

An objective states what it needs: `points` (every design point of a run has its number), `full_read_out`
(what a run answers at the end of the window) or `hardware` (design points on a chip). It is a pure function
of that record; nothing here reads files.

To add one, here or in a module of your own, write a file with

    @register("objectives", "recall_worst")
    @dataclass(frozen=True)
    class RecallWorst:
        needs = "full_read_out"
        columns = (Column("recall_worst", "", "max", "Recall of the class that is recognised worst."),)

        def measure(self, answer: FullReadOut) -> Mapping[str, float]: ...

`dse.testing.check_objective` says what it lacks. A search space names its columns in `objectives`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol, Self, TypeVar

import numpy as np

from dse.base import registry
from dse.base.records import Array, DecisionSurface, Floats, Ints, Operations, Outcome, Workload
from dse.base.registry import Column
from dse.config.settings import Schedule
from dse.measure.hardware.cost import Cost, cost
from dse.measure.hardware.profile import Profile

Needs = Literal["points", "full_read_out", "hardware"]
Number = float | int | bool | None
T_contra = TypeVar("T_contra", contravariant=True)


@dataclass(frozen=True)
class Points:
    """Design points of one run that answer in one way; arrays (...) hold one number per point.

    n_samples: validation samples behind each number.
    accuracy: fraction that is answered correctly.
    accuracy_test: the same of the test set, for the report alone; None without one.
    decision_latency_ms: mean time of the decision on the sensor's clock.
    spikes: (..., layer) mean spikes per inference, those of the input first.
    n_weights: stored weights that the answer needs.
    load: mean work per inference.
    decisions: of a grid over (phi, theta), all of it; None of read-outs.
    spikes_test: (...) spikes of hidden and output layers, summed over the test set; None without one.
    n_inputs: input channels, delayed copies counted; n_neurons: hidden and output neurons. None where the
        classifier does not say.
    shifted: (shift, ...) accuracy on moved windows of `n_shifted` samples; None where none were moved.
    unshifted: (...) accuracy on the windows of the same samples where they were not moved.
    """

    n_samples: int
    accuracy: Floats
    accuracy_test: Floats | None
    decision_latency_ms: Floats
    spikes: Floats
    n_weights: Ints
    load: Workload | Operations
    decisions: DecisionSurface | None = None
    spikes_test: Ints | None = None
    n_inputs: int | None = None
    n_neurons: int | None = None
    shifted: Floats | None = None
    n_shifted: int = 0
    unshifted: Floats | None = None


@dataclass(frozen=True)
class FullReadOut:
    """What a run answers at the end of the window to the n validation samples.

    outcome: what the model family returned.
    label: (n,) answered class; -1 where the heads of a joint net name a combination that no class is.
    target: (n,) true class.
    confusion: (true class, answered class) counts; of a joint net the last column counts the labels -1.
    decision_latency_ms: length of the window.
    read_outs: the same run after k shorter inputs, this one last; None of a joint net, whose heads have them.
    decisions: what the decision maker reaches over its grid; None without a grid, and of a joint net.
    decisions_test, confusion_test, target_test: the same of the test set; None without one.
    most_output_spikes: in a sample; None of what has no output spikes, and of a joint net.
    unseen: label column -> fold of its values -> accuracy after a training without the fold.
    """

    outcome: Outcome
    label: Ints
    target: Ints
    confusion: Ints
    decision_latency_ms: float
    read_outs: Points | None
    decisions: DecisionSurface | None
    decisions_test: DecisionSurface | None = None
    confusion_test: Ints | None = None
    most_output_spikes: int | None = None
    target_test: Ints | None = None
    unseen: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Priced:
    """Design points on a chip: what each costs, the work that it is for, and the chip's schedule."""

    cost: Cost
    load: Workload | Operations
    schedule: Schedule | None = None

    @classmethod
    def on(cls, profile: Profile, load: Workload | Operations) -> Self:
        """Price some work.

        Raises:
            NotApplicable: the chip cannot run such a classifier.
        """
        return cls(cost(profile, load), load, profile.schedule)


class Objective(Protocol[T_contra]):
    """One or more columns of the tables that are measured together.

    needs: 'points', 'full_read_out' or 'hardware': `measure` takes `Points`, a `FullReadOut` or `Priced`.
    columns: what it may return.
    """

    @property
    def needs(self) -> str: ...

    @property
    def columns(self) -> tuple[Column, ...]: ...

    def measure(self, record: T_contra, /) -> Mapping[str, Array | Number]:
        """Return numbers by column: an array (...) of points, one number (None: there is none) of a read-out.

        A column that has no meaning for the record is left out.
        """


def measured(needs: Needs, record: Points | FullReadOut | Priced) -> dict[str, Any]:
    """Return the columns of all registered objectives that need such a record.

    Raises:
        TypeError: an objective returns a column that it does not declare.
    """
    result: dict[str, Any] = {}
    known = registry.known("objectives")
    for name in dict.fromkeys([*(name for name in _ORDER if name in known), *known]):
        objective: Objective[Any] = known[name]()
        if objective.needs != needs:
            continue
        columns = objective.measure(record)
        declared = [column.name for column in objective.columns]
        if undeclared := sorted({*columns} - {*declared}):
            raise TypeError(
                f"objective '{name}' must declare its columns, got {', '.join(undeclared)} as well"
            )
        result |= {column: columns[column] for column in declared if column in columns}
    return result


def need_no_decisions(columns: Iterable[str]) -> bool:
    """Return whether each column is one of every read-out or chip, so none is the decision maker's."""
    of_read_outs = {
        column.name
        for cls in registry.known("objectives").values()
        for column in (cls().columns if cls().needs != "full_read_out" else ())
    }
    return of_read_outs.issuperset(columns)


_ORDER = ("accuracy", "accuracy_shifted", "accuracy_unseen", "work", "recognition", "reaction_times")
"""Objectives in the order of their columns in tables; others follow by name."""


def flat(columns: Mapping[str, Any]) -> dict[str, Any]:
    """Return columns whose values are plain numbers, or None."""
    return {name: x.item() if isinstance(x, np.ndarray | np.generic) else x for name, x in columns.items()}
