"""The training runs of a study: what the folder holds of them, and how each ended.

A run is (trial, repeat). It is finished when its file exists and is undamaged. A failed run is finished too;
its record has the reason. What the machine did (a worker killed, no memory, a lost file) fails no run: it is
left to the next session.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from dse import store
from dse.base import seeds
from dse.config import ConfigError, Fault
from dse.store import Damaged, StoreError
from dse.study import checkpoints
from dse.study.claim import Key
from dse.study.data_sets import DataSets
from dse.study.executors.work import Failure
from dse.study.held import named
from dse.study.ledger import Entry
from dse.study.record import RunRecord, load_record
from dse.study.session import Session
from dse.study.trials import trials_table

UNTRAINED = "not trained: "
"""Begins the sentences about designs that the machine kept from being trained."""


class Runs:
    """The runs of one study folder.

    Args:
        session: of the study.
        data: the data sets of its designs.
        on_trial: called with the row of each trial that ends here.
    """

    def __init__(
        self, session: Session, data: DataSets, on_trial: Callable[[dict[str, Any]], object] | None = None
    ) -> None:
        self._session, self._data, self._on_trial = session, data, on_trial
        self._space, self._book, self._progress = session.space, session.book, session.progress
        self._records: dict[int, dict[int, RunRecord]] = {}  # trial -> repeat -> record
        self._work: dict[Key, float] = {}  # of planned runs: estimated seconds of training
        self._untrained: dict[Key, str] = {}  # why the machine could not train a run
        self._paused: dict[tuple[int, int, int], RunRecord] = {}  # runs at rungs: trial, repeat, epochs

    def of(self, trial: int) -> list[RunRecord]:
        """Return the records of a trial's finished runs, repeat 0 first."""
        return [record for _, record in sorted(self._records.get(trial, {}).items())]

    def trials(self) -> dict[int, list[RunRecord]]:
        """Return trial number -> records, for every trial with a finished run."""
        return {number: self.of(number) for number in sorted(self._records)}

    def count(self, repeats: int | None = None) -> int:
        """Return the number of finished runs, with `repeats` only among the first ones of every trial."""
        runs = (repeat for repeats_of in self._records.values() for repeat in repeats_of)
        return sum(repeats is None or repeat < repeats for repeat in runs)

    def stands(self, key: Key, until: int | None) -> bool:
        """Return whether a run has ended, or stands at the rung to which it is to train."""
        return self._has(*key) or self._is_paused(*key, until)

    def _has(self, trial: int, repeat: int) -> bool:
        """Return whether a run has ended."""
        return repeat in self._records.get(trial, {})

    def _is_paused(self, trial: int, repeat: int, until: int | None) -> bool:
        """Return whether a run stands at the rung to which it is to train."""
        if until is None:
            return False
        key = trial, repeat, until
        if key not in self._paused and (record := checkpoints.at_rung(self._book.folder, *key)) is not None:
            self._check_data(record)
            self._paused[key] = record
        return key in self._paused

    def is_untrained(self, trial: int) -> bool:
        """Return whether the machine kept a run of a trial from being trained."""
        return any(trial == number for number, _ in self._untrained)

    def untrained(self) -> list[str]:
        """Return a sentence on the designs that the machine kept from being trained, if there are any."""
        if not self._untrained:
            return []
        trials = sorted({trial for trial, _ in self._untrained})
        first = next(iter(self._untrained.values()))
        return [
            f"{UNTRAINED}{len(trials)} design{'s' * (len(trials) > 1)}, {named(trials)}, because of the "
            f"machine ({first}); the same command tries again"
        ]

    def recall(self, entries: Sequence[Entry]) -> None:
        """Read the runs that earlier sessions finished.

        A damaged run is removed and repeated, and so is a run that failed for memory that is available now.

        Raises:
            ConfigError: a run was trained on other data than its design has now.
        """
        for entry in entries:
            for repeat in range(max(self._space.search.repeats, self._space.search.repeats_on_front)):
                if self._has(entry.trial, repeat):
                    continue
                path = store.run_file(self._book.folder, entry.trial, repeat)
                own = seeds.design_key(entry.design), self._space.seed
                try:
                    record = load_record(path)
                    if record is not None and (seeds.design_key(record.design), record.seed) != own:
                        raise Damaged(f"{path}: holds a run of another design or seed")
                except Damaged as error:
                    what = str(error).removesuffix(f"; {store.REMEDY}")
                    self._progress.note(f"{what}; this run is repeated")
                    self._forget(path)
                    continue
                if record is None:
                    if store.known_as(path):
                        store.note_files(self._book, [path])
                elif (record.needs_bytes or math.inf) <= self._session.budget:
                    self._forget(path)
                else:
                    self._check_data(record)
                    self._note(path)
                    self._records.setdefault(entry.trial, {})[repeat] = record

    def _note(self, run: Path) -> None:
        """Let the book know a run that is as it should be, unless it does."""
        if not store.known_as(run):
            store.note_files(self._book, [run])

    def _forget(self, run: Path) -> None:
        """Remove a run, if it is there, and let the book know; another one may take its place then."""
        store.remove(run)
        if store.known_as(run):
            store.note_files(self._book, [run])

    def forget_checkpoints(self) -> None:
        """Remove the checkpoints of runs that have ended."""
        ended = {(trial, x) for trial, of in self._records.items() for x in of}
        checkpoints.forget(self._book.folder, ended)

    def paused(self, trial: int, repeats: int, epochs: int) -> list[RunRecord] | None:
        """Return the records of a trial's runs at a rung where all of them pause; None: not all do."""
        for repeat in range(repeats):
            if self._has(trial, repeat) or not self._is_paused(trial, repeat, epochs):
                return None
        return [self._paused[trial, repeat, epochs] for repeat in range(repeats)]

    def stop(self, trial: int, repeats: int, epochs: int, reason: str) -> None:
        """Record that racing stops the runs of a trial at a rung."""
        for repeat in range(repeats):
            if not self._has(trial, repeat) and self._is_paused(trial, repeat, epochs):
                at_rung = self._paused[trial, repeat, epochs]
                self._end(dataclasses.replace(at_rung, numbers=None, stopped_at_epoch=epochs, reason=reason))

    def plan(self, key: Key, cost: float) -> None:
        """Take notice of estimated seconds of training that a run is about to take."""
        self._work[key] = self._work.get(key, 0.0) + cost

    def leave(self, key: Key, why: Failure) -> None:
        """Leave a run to the next session, because of the machine."""
        self._untrained[key] = why.reason
        self._progress.note(f"trial {key[0]} is not trained: {why.reason}; the next run tries again")

    def settle(self, key: Key, until: int | None = None) -> None:
        """Record a run that a worker has published, or that stands at a rung, unless it is recorded already.

        Raises:
            StoreError: it is not there.
        """
        if self._has(*key):
            return
        path = store.run_file(self._book.folder, *key)
        if (record := load_record(path)) is not None:
            self._note(path)
            self._keep(record)
        elif self._is_paused(*key, until):
            self._progress.doing(f"trial {key[0]} has trained {until} epochs")
        else:
            raise StoreError(f"{path}: was removed while the study ran; run the same command again")

    def fail(self, entry: Entry, repeat: int, why: Failure, needs_bytes: int | None = None) -> None:
        """Record a failed run, unless it has ended.

        Args:
            entry: its design.
            repeat: of the design.
            why: it failed.
            needs_bytes: of memory; a later session that has as much repeats it.
        """
        if not self._has(entry.trial, repeat):
            self._end(
                RunRecord(
                    trial=entry.trial,
                    repeat=repeat,
                    design=entry.design,
                    seed=self._space.seed,
                    reason=why.reason,
                    details=why.details,
                    needs_bytes=needs_bytes,
                )
            )

    def _end(self, record: RunRecord) -> None:
        """Write a run that ends without having trained to its end."""
        path = store.run_file(self._book.folder, record.trial, record.repeat)
        store.save_run(path, record.to_plain(), {})
        store.note_files(self._book, [path])
        checkpoints.remove(self._book.folder, record.trial, record.repeat)
        self._keep(record)

    def _keep(self, record: RunRecord) -> None:
        self._records.setdefault(record.trial, {})[record.repeat] = record
        self._progress.advance(_sentence(record), self._work.get((record.trial, record.repeat), 0.0))
        runs = self.of(record.trial)
        if self._on_trial is not None and len(runs) == self._space.search.repeats:
            row = trials_table(self._space, {record.trial: runs}).iloc[0]
            self._on_trial({str(name): store.plain_cell(value) for name, value in row.items()})

    def remark(self, sentences: Sequence[str], prefix: str) -> None:
        """Print sentences about the study, and store them as warnings in place of those with the prefix."""
        known = self._book.document(store.WARNINGS, [])
        for text in sentences:
            self._progress.note(f"warning: {text}")
        now = [*(text for text in known if not text.startswith(prefix)), *sentences]
        if now != known:
            self._book.keep(store.WARNINGS, now)

    def _check_data(self, record: RunRecord) -> None:
        if record.data and self._data.key(record.design, self._data.fold(record.repeat)) != record.data:
            text = (
                f"data: the recordings differ from those that trial {record.trial} was trained on; "
                "restore them, or use another --results folder"
            )
            raise ConfigError([Fault(str(self._space.source), 0, text)])


def _sentence(record: RunRecord) -> str:
    name = f"trial {record.trial}" + (f" repeat {record.repeat}" if record.repeat else "")
    if record.stopped_at_epoch is not None:
        return f"{name} stopped after {record.stopped_at_epoch} epochs: {record.reason}"
    if record.numbers is None:
        return f"{name} failed: {record.reason}"
    return f"{name} accuracy {record.numbers.columns['accuracy']:.3f}"
