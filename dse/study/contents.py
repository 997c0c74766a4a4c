"""What the folder of a study holds, as far as it can be read: for the checks of `dse doctor`."""

from __future__ import annotations

import contextlib
import itertools
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from dse import store
from dse.store import StoreError
from dse.study import ledger
from dse.study.journal import Entry, read_journal
from dse.study.lines import Lines
from dse.study.lines import read as read_lines
from dse.study.record import IMPORTED, RunRecord, load_record
from dse.study.results import plain_space

AUDIT = "racing/audit.json"
MALFORMED = (LookupError, TypeError, ValueError, AttributeError)
"""What reading a document raises that holds something else."""


@dataclass(frozen=True)
class Contents:
    """What can be read in the folder of a study."""

    folder: Path

    @cached_property
    def space(self) -> Mapping[str, Any]:
        """Its search space, empty if that cannot be read."""
        with contextlib.suppress(StoreError):
            return plain_space(self.folder / store.SPACE)
        return {}

    @cached_property
    def lines(self) -> Lines:
        """The lines of its journal."""
        try:
            return read_lines(self.folder / store.JOURNAL)
        except StoreError as error:
            return Lines(faults=[said(error, self.folder / store.JOURNAL)])

    @cached_property
    def entries(self) -> Sequence[Entry]:
        """The designs of its journal."""
        return read_journal(self.folder / store.JOURNAL)

    @cached_property
    def runs(self) -> Mapping[Path, RunRecord | StoreError]:
        """Folder of a run -> its record, or why it has none."""
        runs: dict[Path, RunRecord | StoreError] = {}
        for run in sorted(self.folder.glob("artefacts/*/*")):
            if run.is_dir() and not store.is_temporary(run):
                try:
                    found = load_record(run)
                    assert found is not None  # of a folder
                    runs[run] = found
                except StoreError as error:
                    runs[run] = error
        return runs

    @cached_property
    def records(self) -> dict[int, dict[int, RunRecord]]:
        """Trial -> repeat -> record, of the runs that can be read."""
        records: dict[int, dict[int, RunRecord]] = {}
        for found in self.runs.values():
            if isinstance(found, RunRecord):
                records.setdefault(found.trial, {})[found.repeat] = found
        return records

    @cached_property
    def rounds(self) -> dict[int, list[dict[str, Any]]]:
        """Batch -> the rounds that racing has decided, where they can be read."""
        rounds = {}
        for path in sorted(self.folder.glob("racing/[0-9]*.json")):
            with contextlib.suppress(StoreError, *MALFORMED):
                rounds[int(path.stem)] = rounds_in(self, path)
        return rounds

    @cached_property
    def stops(self) -> dict[int, dict[str, Any]]:
        """Trial -> how racing stopped it, by the rounds, else by its record: it stood at no later rung."""
        rounds = itertools.chain.from_iterable(self.rounds.values())
        stops = {x["trial"]: x for one in rounds for x in one["stopped"]}
        rungs = (self.search.get("racing") or {}).get("rungs", ())
        for trial, of in self.records.items():
            record = next(iter(of.values()))
            epochs, stood = record.stopped_at_epoch, max(record.rungs, default=0)
            if epochs is None and record.finished and stood and trial < IMPORTED:
                is_stopped = any(stood < x < record.sections["training"]["epochs"] for x in rungs)
                epochs = stood if is_stopped else None
            if epochs is not None:
                reason = record.reason or "an audit has trained it on"
                stops.setdefault(trial, {"trial": trial, "epochs": epochs, "reason": reason})
        return stops

    @cached_property
    def audited(self) -> set[int]:
        """The stopped designs that the audit of racing trains on."""
        with contextlib.suppress(StoreError, *MALFORMED):
            return set(store.read_json(self.folder / AUDIT)["trials"])
        return set()

    @cached_property
    def batches(self) -> dict[int, list[int]]:
        """Batch -> its trials, those that are not trained too."""
        batches: dict[int, list[int]] = {}
        for entry in self.entries:
            batches.setdefault(entry.batch, []).append(entry.trial)
        return batches

    @cached_property
    def faults(self) -> list[str]:
        """What is wrong with the journal, beside its last line; without them it names every design."""
        if fault := ledger.of_another(self.folder, self.lines.logs):
            return [fault]
        faults = self.lines.faults or ledger.drop_refused([*self.lines.logs])
        return faults or ledger.lost(self.folder, self.lines.logs)

    @property
    def search(self) -> Mapping[str, Any]:
        """The settings of its search."""
        return self.space.get("search") or {}

    @property
    def repeats(self) -> int:
        """Runs of every design."""
        return int(self.search.get("repeats", 1))

    def knows(self, trial: int) -> bool:
        """Return whether the journal names a trial, or it was imported; True where the journal is damaged."""
        return bool(self.faults) or 0 <= trial < len(self.entries) or trial >= IMPORTED

    def name(self, path: Path) -> str:
        return str(path.relative_to(self.folder))


def rounds_in(study: Contents, path: Path) -> list[dict[str, Any]]:
    """Return the rounds of a batch.

    Raises:
        ValueError, KeyError, TypeError: it holds other things, or names a trial of another batch.
        StoreError: it cannot be read.
    """
    rounds = list(store.read_json(path)["rounds"])
    known = set(study.batches.get(int(path.stem), ()))
    for one in rounds:
        stopped = [x["trial"] for x in one["stopped"] if int(x["epochs"]) and str(x["reason"])]
        if not study.faults and (unknown := {*one["trials"], *stopped} - known):
            raise ValueError(f"names trial {min(unknown)}, which is not in batch {int(path.stem)}")
        if one["epochs"] is not None and int(one["epochs"]) < 1:
            raise ValueError(f"has a rung of {one['epochs']} epochs")
    return rounds


def said(error: Exception, path: Path) -> str:
    """Return what an error says of a file, without the file and the remedy."""
    if isinstance(error, LookupError):
        return f"holds something else (key {error} is missing)"
    text = str(error).splitlines()[0].removesuffix(f"; {store.REMEDY}")
    return text.removeprefix(f"{path}: ").removeprefix(f"{path}/")


def matches(folder: Path, pattern: str) -> list[Path]:
    """Return what a folder holds of a pattern, links that lead nowhere too."""
    if "*" not in pattern:
        return [folder / pattern] if os.path.lexists(folder / pattern) else []
    paths = sorted(folder.glob(pattern))
    return [path for path in paths if ".damaged" not in path.name and not store.is_temporary(path)]


def set_aside(folder: Path, path: Path) -> None:
    """Move what lies in a study's folder to beside where it lay, under a name that nothing reads."""
    first, *rest = path.relative_to(folder).parts
    for n in itertools.count():
        top = folder / f"{first}.damaged{n or ''}"
        place = top.joinpath(*rest)
        if not os.path.lexists(place) and (not os.path.lexists(top) or top.is_dir()):
            with store.explained(place):
                place.parent.mkdir(parents=True, exist_ok=True)
                path.replace(place)
            return
