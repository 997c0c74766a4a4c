"""A search says which trainings come next: a stack of objects with `ask` and `tell`, and nothing else.

`ask()` returns trainings, or None where it has no more; `tell(asked)` follows when these have ended, failed
or been left to the next session. What a search needs to know of them, it finds in the runs
(`dse.study.runs`) and in the book, so it asks the same again after an interruption. A search that changes
another one holds it, and passes on what it does not change. The innermost is `Batches`; racing is in
`dse.study.racing`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from dse.base.seeds import design_key
from dse.config import SearchSpace
from dse.config.space import Design
from dse.search.limits import Exclusion
from dse.search.proposals import Limited, Sampler, limited
from dse.search.space import design_at
from dse.study import trials as tables
from dse.study.data_sets import DataSets
from dse.study.known import KnownBefore
from dse.study.ledger import Entry, Ledger
from dse.study.precision import fronts
from dse.study.queue import on_axes
from dse.study.record import RunRecord
from dse.study.runs import Runs
from dse.study.session import Session

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True)
class Asked:
    """Trainings of some designs.

    repeats: runs of each. batch: number of the batch that they are of, -1 for none.
    until: epochs of the rung to which they train; None: to their ends.
    """

    entries: Sequence[Entry]
    repeats: int
    batch: int = -1
    until: int | None = None


class Search(Protocol):
    """Says which trainings come next."""

    def ask(self) -> Asked | None:
        """Return the next trainings; None: there are no more."""

    def tell(self, asked: Asked) -> None:
        """Take notice that trainings have ended."""


class FrontRepeats:
    """After a search: the designs on each family's fronts, until all have their repeats.

    Each run may move a front.
    """

    def __init__(
        self, session: Session, ledger: Ledger, runs: Runs, points: Callable[[], pandas.DataFrame]
    ) -> None:
        self._space, self._report = session.space, session.progress
        self._ledger, self._runs, self._points = ledger, runs, points

    def ask(self) -> Asked | None:
        """Return the designs on the fronts that lack repeats."""
        repeats, runs = self._space.search.repeats_on_front, self._runs
        if repeats <= self._space.search.repeats:
            return None
        in_turn = fronts(self._points(), self._space.objectives)
        front = {trial for _, rows in in_turn for trial in rows["trial"]}
        short = [
            e
            for e in self._ledger.entries
            if e.trial in front and len(runs.of(e.trial)) < repeats and not runs.is_untrained(e.trial)
        ]
        self._report.expect(sum(repeats - len(runs.of(e.trial)) for e in short))
        return Asked(short, repeats) if short else None

    def tell(self, asked: Asked) -> None:
        """Take no notice: the next front is of the points."""


# Designs of a grid whose data sets are prepared together, and excluded ones that are written down.
_MOST_PREPARED, _MOST_RECORDED = 100_000, 1000


class Batches:
    """The batches of one study.

    Args:
        session: of the study.
        ledger: its designs.
        runs: its runs.
        data: the data sets of its designs.
        before: what is known of a design before it is trained; None without limits.
    """

    def __init__(
        self, session: Session, ledger: Ledger, runs: Runs, data: DataSets, before: KnownBefore | None
    ) -> None:
        space = self._space = session.space
        self._ledger, self._runs, self._before, self._report = ledger, runs, before, session.progress
        self._excluded = {design_key(e.design) for e in ledger.entries if e.excluded}
        self._number = 0
        directions = [direction for _, direction in space.objectives]
        self._sampler: Sampler = space.search.sampler.start(space, directions)
        self._limited: Limited | None = None
        if before is not None:
            self._sampler = self._limited = limited(self._sampler, self._check)
            if before.needs_data and space.n_designs is not None and space.n_designs <= _MOST_PREPARED:
                data.shapes(design_at(space, index) for index in range(space.n_designs))

    def of(self, number: int) -> list[Entry]:
        """Return the designs of a batch that are trained."""
        return [entry for entry in self._ledger.batch(number) if not entry.excluded]

    def ask(self) -> Asked | None:
        """Return the designs of the next batch that are trained; None where the search ends."""
        number = self._number
        self._ledger.read()
        self._exclude(number)
        if not self._ledger.batch(number):
            self._take_queue(number)
        entries = self.of(number)
        if not any(entry.enqueued or entry.is_reported for entry in entries):
            # Limits of today may have left part of a batch.
            n_before = sum(e.batch < number and not e.excluded for e in self._ledger.entries)
            n_left = n_trials(self._space) - n_before - len(entries)
            n = min(self._space.search.batch - len(entries), n_left)
            if n > 0:
                new = self._propose(number, n)
                if new is not None and len(new) < n:
                    n_now = n_before + len(entries) + len(new)
                    self._report.note(f"the sampler found no further designs; the study has {n_now}")
        is_begun = any(not entry.excluded or entry.enqueued for entry in self._ledger.batch(number))
        return Asked(self.of(number), self._space.search.repeats, number) if is_begun else None

    def _propose(self, number: int, n: int) -> list[Design] | None:
        """Add up to n designs of the sampler to a batch and return them; None: another coordinator did."""
        known = {design_key(e.design) for e in self._ledger.entries if not e.excluded}
        there = self._ledger.batch(number)
        proposed = self._sampler.ask(len(self.of(number)) + n)
        new = [design for design in proposed if design_key(design) not in known][:n]
        with self._ledger.together():
            if self._ledger.batch(number) != there:
                return None
            for design, why in [] if self._limited is None else self._limited.refused:
                is_full = len(self._excluded) >= _MOST_RECORDED and self._space.search.sampler_name == "grid"
                if design_key(design) not in self._excluded and not is_full:
                    self._excluded.add(design_key(design))
                    self._ledger.exclude(number, design, why)
            self._ledger.ask(number, new)
        return new

    def tell(self, asked: Asked) -> None:
        """Write down how the designs of a batch have ended, and let the sampler learn from them."""
        number, self._number = asked.batch, asked.batch + 1
        with self._ledger.together():
            for entry in self.of(number):
                if not entry.is_reported and not self._runs.is_untrained(entry.trial):
                    records = self._runs.of(entry.trial)[: self._space.search.repeats]
                    values, at_rungs = values_of(self._space, records), _at_rungs(self._space, records)
                    stopped = any(one.stopped_at_epoch is not None for one in records)
                    self._ledger.tell(entry.trial, values, at_rungs, stopped=stopped)
        if self._limited is not None:
            for entry in self._ledger.batch(number):
                if entry.excluded and self._check(entry.design) is not None:
                    self._limited.tell([entry.design], [None])
        ended = self.of(number)
        self._sampler.tell([entry.design for entry in ended], list(map(self._told, ended)))

    def _told(self, entry: Entry) -> tuple[float, ...] | None:
        """Return the objectives of a design as the sampler learns them; None where it misses a limit."""
        records = self._runs.of(entry.trial)[: self._space.search.repeats]
        if entry.values is None or self._before is None or self._before.meets(entry.design, records):
            return entry.values
        return None

    def _check(self, design: Mapping[str, object]) -> Exclusion | None:
        assert self._before is not None  # there are limits
        return self._before.exclusion(design)

    def _exclude(self, number: int) -> None:
        """Exclude what an earlier session proposed in a batch and has not trained, by limits of today."""
        for entry in self.of(number) if self._before is not None else ():
            if not entry.is_reported and not self._runs.of(entry.trial):
                if why := self._before.exclusion(entry.design) if self._before is not None else None:
                    self._ledger.exclude_proposed(entry.trial, why)
                    self._excluded.add(design_key(entry.design))

    def _take_queue(self, number: int) -> None:
        """Make a batch of the designs that the user asked for and that are not in the study yet."""
        with self._ledger.together():
            waiting = [] if self._ledger.batch(number) else self._ledger.book.rows("queue")
            known = {design_key(e.design): e.trial for e in self._ledger.entries if not e.excluded}
            for row in waiting:
                design = on_axes(self._space, row["design"])
                key = "" if design is None else design_key(design)
                if design is None:
                    self._report.note("an enqueued design is none of this search space; it is left out")
                elif key in known:
                    self._report.note(f"an enqueued design is trial {known[key]} already")
                elif self._before is not None and (why := self._before.exclusion(design)) is not None:
                    self._report.note(f"an enqueued design is not trained: {why.reason}")
                else:
                    self._ledger.ask(number, [design], enqueued=True)
                    known[key] = len(self._ledger.entries) - 1
                self._ledger.book.drop("queue", "place = ?", row["place"])


def n_trials(space: SearchSpace) -> int:
    """Return the number of designs that a search trains."""
    return space.search.n_trials or space.n_designs or 0


def values_of(space: SearchSpace, records: Sequence[RunRecord]) -> tuple[float, ...] | None:
    """Return the objectives of a trial's full read-out, None if it failed or lacks one of them.

    Those of a trial that stopped early are as they were then.
    """
    if any(record.failed for record in records):
        return None
    numbers = [record.last for record in records]
    row = tables.summary(numbers, next(iter(numbers[0].hardware), None))
    values = [float(row.get(name, math.nan)) for name, _ in space.objectives]
    return tuple(values) if all(map(math.isfinite, values)) else None


def _at_rungs(space: SearchSpace, records: Sequence[RunRecord]) -> dict[int, float]:
    """Return epochs -> the first objective of a trial's full read-out at that rung, where it has one."""
    name = space.objectives[0][0]
    values = {}
    for epochs in sorted(set.intersection(*(set(one.rungs) for one in records))):
        numbers = [one.rungs[epochs] for one in records]
        value = float(tables.summary(numbers, next(iter(numbers[0].hardware), None)).get(name, math.nan))
        if math.isfinite(value):
            values[epochs] = value
    return values
