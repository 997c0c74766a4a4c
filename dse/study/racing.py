"""Racing: designs train from rung to rung, and stop where others are ahead of them.

A batch of designs is raced in rounds. A round names designs and the rung to which they train, or the end.
When all of them stand there, the next round is decided: one in `eta` goes on to the next rung, and two
per objective at least; the others stop. Designs of a task, a family and a chip compete, by the full read-out
at the rung, with all designs that have stood there before, in this batch or an earlier one
(`dse.search.racing`). A design goes on if it is among the best anywhere. Designs that lack an objective
come last.

A round is written to the disk before its designs train, and is decided from records of designs at this rung
alone. So the same designs stop for any number of workers, and after any interruption.

Documents of the book: `racing/<batch>`, the rounds of a batch, and `racing/saved`, a sentence.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dse import store
from dse.base.records import Floats
from dse.measure.numbers import Numbers
from dse.search.racing import best
from dse.study import trials as tables
from dse.study.ledger import Entry
from dse.study.record import RunRecord
from dse.study.runs import Runs
from dse.study.searches import Asked, Search
from dse.study.session import Session

SAVED = "racing/saved"

_LEAST = 2
"""Designs per objective that go on at least: fewer do not span a front."""

Group = tuple[str, ...]
"""Task, family and chip: designs of a group compete."""


class Race:
    """The racing of one study: a search whose batches are asked for round by round."""

    def __init__(self, search: Search, session: Session, runs: Runs) -> None:
        space, book = session.space, session.book
        assert space.search.racing is not None
        self._search, self._runs = search, runs
        self._space, self._book, self._profiles = space, book, session.profiles
        self._eta = space.search.racing.eta
        self._rungs = space.search.racing.at(min(space.parts["training"].range("epochs")))
        rounds = (one for of_batch in rounds_of(book).values() for one in of_batch)
        self._stopped = {int(stop["trial"]) for one in rounds for stop in one["stopped"]}
        self._stopped.update(trial for trial, of in runs.trials().items() if any(map(_is_stopped, of)))
        self._batch: Asked | None = None
        self._trainings: Iterator[Asked] = iter(())

    def ask(self) -> Asked | None:
        """Return trainings of a batch to a rung or to their ends; after the last, those of the next batch."""
        while (asked := next(self._trainings, None)) is None:
            if self._batch is not None:
                self._search.tell(self._batch)
            self._batch = self._search.ask()
            if self._batch is None:
                return None
            self._trainings = self._raced(self._batch)
        return asked

    def tell(self, asked: Asked) -> None:
        """Take no notice: the next round is decided from the runs."""

    def _raced(self, batch: Asked) -> Iterator[Asked]:
        """Yield the trainings of a batch until each of its designs has finished, failed or stopped."""
        name = f"racing/{batch.batch:05d}"
        rounds: list[dict[str, Any]] = self._book.document(name, [])
        self._runs.recall(batch.entries)
        upcoming: dict[str, Any] | None = None
        if not rounds:
            first = [entry.trial for entry in batch.entries]
            upcoming = {"epochs": self._rungs[0], "trials": first, "stopped": []}
        while True:
            if upcoming is not None:
                rounds.append(upcoming)
                self._book.keep(name, rounds)
            self._stop(rounds)
            stands = {int(trial): one["epochs"] for one in rounds for trial in one["trials"]}
            for epochs in sorted(set(stands.values()), key=lambda n: math.inf if n is None else n):
                there = [entry for entry in batch.entries if stands.get(entry.trial, 0) == epochs]
                yield replace(batch, entries=there, until=epochs)
            self._stop(rounds)  # who stopped before, and had to train to the rung again
            upcoming = self._next(stands)
            if upcoming is None:
                break
        left = [e for e in batch.entries if e.trial not in self._stopped or not self._runs.of(e.trial)]
        yield replace(batch, entries=left)

    def _stop(self, rounds: Iterable[Mapping[str, Any]]) -> None:
        """Record what rounds have stopped, unless it is recorded."""
        for stop in (stop for one in rounds for stop in one["stopped"]):
            self._stopped.add(int(stop["trial"]))
            repeats, epochs = self._space.search.repeats, int(stop["epochs"])
            self._runs.stop(int(stop["trial"]), repeats, epochs, stop["reason"])

    def _next(self, stands: Mapping[int, int | None]) -> dict[str, Any] | None:
        """Return the next round of a batch; None: no design pauses."""
        at_rung = {
            trial: (epochs, records)
            for trial, epochs in stands.items()
            if epochs is not None and trial not in self._stopped
            for records in [self._runs.paused(trial, self._space.search.repeats, epochs)]
            if records is not None
        }
        if not at_rung:
            return None
        epochs = min(epochs for epochs, _ in at_rung.values())
        waiting = {trial: of for trial, (n, of) in sorted(at_rung.items()) if n == epochs}
        reasons = self._reasons(waiting, epochs)
        return {
            "epochs": next((rung for rung in self._rungs if rung > epochs), None),
            "trials": [trial for trial in waiting if trial not in reasons],
            "stopped": [
                {"trial": trial, "epochs": epochs, "reason": reason} for trial, reason in reasons.items()
            ],
        }

    def saved(self, entries: Sequence[Entry]) -> str:
        """Keep and return in a sentence how many designs stopped and what that saved; '' if none did."""
        self._runs.forget_checkpoints()
        if not self._stopped:
            return ""
        total = saved = 0
        for entry in entries:
            epochs = self._space.resolve(entry.design).training.epochs
            records = self._runs.of(entry.trial)
            at = records[0].stopped_at_epoch if records else None
            total, saved = total + epochs, saved + (0 if at is None else epochs - at)
        of = f"{len(self._stopped)} of {len(entries)} designs stopped early"
        sentence = f"racing: {of}, which saves {saved / max(1, total):.0%} of all epochs"
        self._book.keep(SAVED, sentence)
        return sentence

    def _reasons(self, waiting: Mapping[int, Sequence[RunRecord]], epochs: int) -> dict[int, str]:
        """Return trial -> why it stops, of the designs at a rung that do not go on.

        Those wait whose runs have these records at the rung; other designs stood there before.
        """
        repeats, goals = self._space.search.repeats, self._space.objectives
        stood: dict[Group, dict[int, Floats]] = {}
        for trial, records in self._runs.trials().items():
            before = [record.rungs[epochs] for record in records[:repeats] if epochs in record.rungs]
            if trial not in waiting and len(before) == repeats:
                for group, values in self._full(records, before):
                    stood.setdefault(group, {})[trial] = values
        for trial, at_rung in waiting.items():
            for group, values in self._full(at_rung, [record.measured for record in at_rung]):
                stood.setdefault(group, {})[trial] = values
        sign = np.array([1.0 if direction == "min" else -1.0 for _, direction in goals])
        going: set[int] = set()
        reasons: dict[int, str] = {}
        for stood_there in stood.values():
            of_group = dict(sorted(stood_there.items()))  # so that ties do not depend on who waits
            n = max(math.ceil(len(of_group) / self._eta), _LEAST * len(goals))
            able = [t for t, values in of_group.items() if np.isfinite(values).all()]
            costs = np.array([sign * of_group[trial] for trial in able]).reshape(len(able), len(goals))
            ahead = [able[place] for place in best(costs, n)]
            ahead += [trial for trial in of_group if trial not in able][: n - len(ahead)]
            going |= set(ahead)
            for trial in of_group.keys() & waiting.keys():
                so_far = f"{goals[0][0]} {of_group[trial][0]:.4g} after {epochs} epochs"
                reasons[trial] = f"{so_far}, not among the best {n} of {len(of_group)} designs there"
        return {trial: reasons[trial] for trial in waiting if trial not in going}

    def _full(
        self, records: Sequence[RunRecord], numbers: Sequence[Numbers]
    ) -> Iterator[tuple[Group, Floats]]:
        """Yield the objectives of a full read-out in each group of a trial; NaN where it has none.

        `numbers` are of each of its runs, at the end or at a rung.
        """
        design = records[0].design
        for head in list[str | None](numbers[0].of_heads) or [None]:
            of_head = [one.of_head(head) for one in numbers]
            named = head or self._space.task_name(design), self._space.kind("model", design)
            for chip in list[str | None](x.name for x in self._profiles) or [None]:
                known = chip if all(chip in one.hardware for one in of_head) else None
                row = tables.summary(of_head, known)
                values = [float(row.get(name, math.nan)) for name, _ in self._space.objectives]
                yield (*named, *([chip] if chip else [])), np.array(values)


def rounds_of(book: store.Book) -> dict[int, list[dict[str, Any]]]:
    """Return batch -> the rounds that racing has decided in it."""
    rows = book.rows("study", "name GLOB 'racing/[0-9]*'")
    return {int(row["name"].removeprefix("racing/")): row["content"] for row in rows}


def _is_stopped(record: RunRecord) -> bool:
    return record.stopped_at_epoch is not None


def saved(folder: Path) -> list[str]:
    """Return what racing has saved in a study, in a sentence; nothing without racing."""
    sentence = store.document(folder, SAVED)
    return [sentence] if sentence else []
