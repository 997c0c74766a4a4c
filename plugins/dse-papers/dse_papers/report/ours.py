"""Our values beside printed numbers: columns of a design on the test set, with their spread over runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from dse.base.records import Array
from dse.measure.objectives.accuracy import seeds_se, wilson_se
from dse.show.report.designs import StudyTask, best, record
from dse.show.report.rows import number
from dse_papers.report.facts import Fact, Facts, facts_of
from dse_papers.report.papers import Number

if TYPE_CHECKING:
    import pandas

SPREAD = ("value", "se", "low", "high")
"""Fields of `Ours` in the unit of the quantity."""
NO_HONEST = "every design of the study has seen the labels"
VALIDATION = "on validation; none of the test set"
ACCURACY: Mapping[str, str] = {"accuracy_test": "", "accuracy": VALIDATION}
"""Columns of `of_column`."""


@dataclass(frozen=True)
class Ours:
    """Our value beside a printed number.

    se, low, high: standard error and range over the runs, which are folds or repeats, or the range of an
    uncertain figure. runs: behind it. row: the design.
    same: whether it is the same quantity. why: why it is not, or why there is none.
    is_accuracy: whether it is the accuracy of the design.
    """

    value: float | str | None = None
    se: float | None = None
    low: float | None = None
    high: float | None = None
    runs: int | None = None
    row: pandas.Series[Any] | None = field(default=None, compare=False)
    same: bool = True
    why: str = ""
    is_accuracy: bool = False


def missing(why: str) -> Ours:
    """Return that there is no value, and why."""
    return Ours(why=why)


@dataclass(frozen=True)
class Side:
    """The designs of a study for one task that stand beside a paper.

    labels: condition -> its value for all of these designs, such as task -> texture.
    families: kinds of models that the paper has.
    """

    part: StudyTask
    labels: Mapping[str, str]
    families: tuple[str, ...]
    _facts: dict[int, Facts] = field(default_factory=dict, init=False, repr=False, compare=False)

    def designs(self, *families: str, transductive: bool = False) -> pandas.DataFrame:
        """Return the designs of some families; none: of all that the paper has."""
        return self.part.of(families or self.families, transductive=transductive)

    @cached_property
    def chosen(self) -> pandas.Series[Any] | None:
        """The best design, which stands for the set-up; one that has seen labels if there is no other."""
        honest = best(self.designs())
        return best(self.designs(transductive=True)) if honest is None else honest

    @cached_property
    def as_printed(self) -> tuple[pandas.Series[Any] | None, bool]:
        """The best design that has seen labels, as the paper has, else the best one; and whether it has."""
        leaky = best(self.designs(transductive=True))
        return (best(self.designs()), False) if leaky is None else (leaky, True)

    def facts(self, row: pandas.Series[Any] | None = None) -> Facts:
        """Return what a design was trained on, and how; None: the best one."""
        design = self.chosen if row is None else row
        if design is None:
            return {}
        trial = int(design["trial"])
        if trial not in self._facts:
            self._facts[trial] = facts_of(self.part, design)
        return self._facts[trial]

    def fact(self, number: Number, row: pandas.Series[Any] | None = None) -> Fact:
        """Return what a design has beside a number of the set-up, under its conditions if facts have them."""
        facts, reads = self.facts(row), number.entry.reads
        return facts.get(".".join([reads, *number.condition.values()]), facts.get(reads))

    @property
    def n_test(self) -> int:
        """Samples of the test set."""
        row = self.chosen
        counts = {} if row is None else record(self.part.study.folder, int(row["trial"])).get("samples", {})
        return int(counts.get("test", 0))

    def confusions(self, row: pandas.Series[Any]) -> tuple[list[Array], bool]:
        """Return the confusion matrix of every run, and whether they are of the test set."""
        runs = self.part.arrays(int(row["trial"]), "confusion")
        on_test = all("test" in run for run in runs)
        return [run["test" if on_test else "validation"] for run in runs], on_test

    def confused(self, n: int = 3) -> str:
        """Return the classes of the best design that are most often taken for one other class."""
        row = self.chosen
        if row is None:
            return ""
        matrices, on_test = self.confusions(row)
        matrix = np.sum(matrices, axis=0)
        names, shares = (
            self.part.classes(int(row["trial"])),
            matrix / np.maximum(matrix.sum(axis=1), 1)[:, None],
        )
        np.fill_diagonal(shares, 0)
        places = np.argsort(-shares, axis=None, kind="stable")[:n]
        pairs = [divmod(int(place), len(names)) for place in places if shares.flat[place] > 0]
        texts = [f"{names[i]} for {names[j]} ({shares[i, j]:.0%})" for i, j in pairs]
        on = "test" if on_test else "validation"
        return f"on {on}, most often taken for another: {', '.join(texts)}" if texts else ""


Measure = Callable[[Side, Mapping[str, str]], Ours]
"""(designs, conditions of the printed number) -> our value."""


def of_column(side: Side, row: pandas.Series[Any] | None, columns: Mapping[str, str]) -> Ours:
    """Return the first column that a design has, with its spread over runs.

    Args:
        side: the designs.
        row: the design; None: there is none.
        columns: name -> why it is another quantity, '' for the same; those of the test set first.
    """
    if row is None:
        return missing("no such design")
    for name, why in columns.items():
        value = number(row.get(name))
        if value is None:
            continue
        each = [x for run in side.part.columns(int(row["trial"])) if (x := number(run.get(name))) is not None]
        ours = replace(over_runs(each, row), value=value, row=row, same=not why, why=why)
        ours = replace(ours, is_accuracy=name.startswith("accuracy"))
        if name.startswith("accuracy") and not ours.se:  # one run, or runs that agree
            n = side.n_test if name.endswith("_test") else side.part.n_validation
            ours = replace(ours, se=float(wilson_se(round(value * n), n)) if n else None)
        return ours
    return replace(missing(f"the study did not record {next(iter(columns))}"), row=row)


def unless_printed(ours: Ours, as_printed: bool, why: str) -> Ours:
    """Return a value as another quantity, and why, unless its design is as printed."""
    if as_printed or ours.value is None:
        return ours
    return replace(ours, same=False, why="; ".join(filter(None, [why, ours.why])))


def without_leak(why: str) -> Measure:
    """Return the measure of accuracy of designs that have seen no labels.

    Args:
        why: why that is another quantity than the printed accuracy.
    """

    def measure(side: Side, condition: Mapping[str, str]) -> Ours:
        row = best(side.designs())
        return missing(NO_HONEST) if row is None else replace(of_column(side, row, ACCURACY), why=why)

    return measure


def over_runs(values: Sequence[float], row: pandas.Series[Any] | None = None) -> Ours:
    """Return the mean of a number over the runs of a design, its standard error and range."""
    if not values:
        return missing("no run has it")
    several = np.asarray(values, dtype=np.float64)
    if len(several) < 2:
        return Ours(float(several[0]), runs=1, row=row)
    se = float(seeds_se(several))
    return Ours(float(several.mean()), se, float(several.min()), float(several.max()), len(several), row)
