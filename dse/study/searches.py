"""A search says which trainings come next: a stack of objects with `ask` and `tell`, and nothing else.

`ask()` returns trainings, or None where it has no more; `tell(asked)` follows when these have ended, failed
or been left to the next session. What a search needs to know of them, it finds in the runs
(`dse.study.runs`) and in the book, so it asks the same again after an interruption. A search that changes
another one holds it, and passes on what it does not change. The innermost is `dse.study.batches.Batches`;
racing is in `dse.study.racing`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from dse.config import SearchSpace
from dse.study.fronts import fronts
from dse.study.ledger import Entry, Ledger
from dse.study.progress import Progress
from dse.study.runs import Runs
from dse.study.warm import Takeover

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


class WarmStart:
    """A search, of which runs that earlier studies have trained are copied before they are asked for."""

    def __init__(self, search: Search, takeover: Takeover, report: Progress) -> None:
        self._search, self._takeover, self._report = search, takeover, report

    def ask(self) -> Asked | None:
        """Return the trainings of the search, some of which are done by now."""
        asked = self._search.ask()
        entries = () if asked is None else asked.entries
        if n := sum(self._takeover.over(entry) for entry in entries if not entry.is_reported):
            self._report.note(f"{n} run{'s' * (n > 1)} of earlier studies taken over")
        return asked

    def tell(self, asked: Asked) -> None:
        """Pass it on."""
        self._search.tell(asked)


class FrontRepeats:
    """After a search: the designs on each family's fronts, until all have their repeats.

    Each run may move a front.
    """

    def __init__(
        self,
        space: SearchSpace,
        ledger: Ledger,
        runs: Runs,
        points: Callable[[], pandas.DataFrame],
        report: Progress,
    ) -> None:
        self._space, self._ledger, self._runs = space, ledger, runs
        self._points, self._report = points, report

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
            if e.trial in front and len(runs.of(e.trial)) < repeats and not runs.is_settled(e.trial)
        ]
        self._report.expect(sum(repeats - len(runs.of(e.trial)) for e in short))
        return Asked(short, repeats) if short else None

    def tell(self, asked: Asked) -> None:
        """Take no notice: the next front is of the points."""
