"""Opening the book of a study to write it; a damaged one is written anew from what is left.

That is its intact rows, and the records of runs: each names its design, its rungs and how it ended. The
sampler proposes again what these do not say. The folder of an earlier version is converted.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from dse import store
from dse.config import SearchSpace
from dse.seeds import design_key
from dse.store import Book, Damaged, StoreError
from dse.store.book import salvaged
from dse.study import convert, held, racing
from dse.study.ledger import Entry
from dse.study.record import IMPORTED, RunRecord, load_record

_COMPARED = 5


def opened(folder: Path, space: SearchSpace | Mapping[str, Any]) -> tuple[Book, list[str]]:
    """Return the book of a study to write it, and what was damaged and is mended, in sentences.

    Args:
        folder: of the study, which the caller has locked.
        space: its search space, also as plain data.

    Raises:
        StoreError: it cannot be read or written now.
    """
    path, notes = folder / store.BOOK, []
    plain: Mapping[str, Any] = space.to_plain() if isinstance(space, SearchSpace) else space
    if convert.is_earlier(folder):
        notes += convert.convert(folder)
    if (path.exists() or store.runs_in(folder)) and (what := fault(folder)):
        n, n_intact = _mend(path, plain.get("search", {}), is_foreign="another study" in what)
        notes.append(
            f"{path}: {what}: it is written anew with {n} trials ({n_intact} had intact rows, others follow "
            f"from the records of their runs); the file before it is {path.name}.damaged"
        )
    return Book(folder, writes=True, is_session=True), notes


def fault(folder: Path) -> str:
    """Return what is wrong with the book of a study, in words; '' if it can be read and names every run.

    Raises:
        StoreError: it cannot be read now.
    """
    path = folder / store.BOOK
    try:
        with Book(folder) as book:
            for table in ("study", "queue", "note", "file"):
                book.rows(table)
            rows, files = book.rows("trial"), book.rows("file")
    except Damaged as error:
        return str(error).removeprefix(f"{path}: ").removesuffix(f"; {store.REMEDY}")
    if [row["trial"] for row in rows] != list(range(len(rows))):
        return "lacks a design"
    recorded = ((row["design"], _design(folder, row["trial"])) for row in rows[:_COMPARED])
    same = [design_key(one) == design_key(other) for one, other in recorded if other is not None]
    if (same and not any(same)) or not _knows_runs(folder, {x["name"]: x["sha256"] for x in files}):
        return "is the book of another study"
    return "" if _design(folder, len(rows)) is None else f"lacks trial {len(rows)}, which has a run"


def _knows_runs(folder: Path, digests: Mapping[str, str]) -> bool:
    """Return whether one of the first runs is as a book says; True where it says nothing of two of them."""
    runs = itertools.islice((store.run_file(folder, *x) for x in _numbers(folder)), _COMPARED)
    known = {run: digests[name] for run in runs if (name := f"{store.RUNS}/{run.name}") in digests}
    return len(known) < 2 or any(store.checksum(run) == digest for run, digest in known.items())


def _numbers(folder: Path) -> list[tuple[int, int]]:
    """Return trial and repeat of every run in a folder."""
    return [(trial, repeat) for trial, repeats in store.runs_in(folder).items() for repeat in repeats]


def _mend(path: Path, search: Mapping[str, Any], *, is_foreign: bool) -> tuple[int, int]:
    """Write a damaged book anew; return the number of its trials, and of those with intact rows."""
    folder = path.parent
    if is_foreign and store.known_as(folder / store.SPACE):
        with contextlib.suppress(Damaged):
            store.verify(folder / store.SPACE)
            store.remove(folder / store.SPACE)  # it came with the book
    tables = {} if is_foreign else salvaged(path)
    intact = {row["trial"]: Entry.of(row) for row in tables.get("trial", ())}
    entries: list[Entry] = []
    while (entry := intact.get(len(entries)) or _recorded(folder, entries, search)) is not None:
        entries.append(entry)
    tables["trial"] = [entry.row() for entry in entries]
    known = {row["name"] for row in tables.setdefault("study", [])}
    documents = dict(raced(_records(folder), entries, search)) if search.get("racing") else {}
    tables["study"] += [{"name": k, "content": x} for k, x in documents.items() if k not in known]
    files = {row["name"] for row in tables.get("file", ())}
    for name in {held.TRIALS, held.POINTS} - files:
        store.remove(
            folder / name
        )  # nothing tells any more whether it is what was written; it follows from runs
    _write_anew(path, tables)
    return len(entries), sum(entry.trial in intact for entry in entries)


def _write_anew(path: Path, tables: Mapping[str, Sequence[Mapping[str, Any]]]) -> None:
    """Write a book with rows by table; the file so far is kept, its name ending in `.damaged`."""
    with store.explained(path):
        aside = path.with_name(f"{path.name}.damaged")
        for old in (aside, *(path.with_name(f"{path.name}{more}") for more in ("-journal", "-wal", "-shm"))):
            store.remove(old)
        if os.path.lexists(path):
            path.replace(aside)
    with Book(path.parent, writes=True) as book, book.together():
        for table, rows in tables.items():
            book.put(table, rows)


def _recorded(folder: Path, before: Sequence[Entry], search: Mapping[str, Any]) -> Entry | None:
    """Return the entry that follows some others by the record of a run; None where none can be read."""
    if (design := _design(folder, len(before))) is None:
        return None
    batch = before[-1].batch if before else 0
    is_full = sum(entry.batch == batch for entry in before) >= int(search.get("batch") or 1)
    return Entry(len(before), batch + is_full, design, time.time())


def _design(folder: Path, trial: int) -> Mapping[str, object] | None:
    """Return the design of a trial by the record of one of its runs; None where none can be read."""
    for run in store.runs_of(folder, trial):
        with contextlib.suppress(StoreError):
            design = store.read_record(run).get("design")
            if isinstance(design, dict):
                return design
    return None


def _records(folder: Path) -> dict[int, list[RunRecord]]:
    """Return trial -> the records of its runs that can be read."""
    records: dict[int, list[RunRecord]] = {}
    for trial, repeat in _numbers(folder):
        with contextlib.suppress(StoreError):
            if trial < IMPORTED and (record := load_record(store.run_file(folder, trial, repeat))):
                records.setdefault(trial, []).append(record)
    return records


def raced(
    records: Mapping[int, Sequence[RunRecord]], entries: Sequence[Entry], search: Mapping[str, Any]
) -> Iterator[tuple[str, Any]]:
    """Yield the documents of racing that records tell: rounds of ended batches, and the audit.

    Args:
        records: trial -> records of its runs, repeat 0 first.
        entries: the designs of the study.
        search: section of its search space as plain data, which races.
    """
    rungs = search["racing"]["rungs"]
    stops = {trial: stop for trial, of in records.items() if (stop := _stop(of[0], rungs))}
    for batch in sorted({entry.batch for entry in entries}):
        trials = [entry.trial for entry in entries if entry.batch == batch and not entry.excluded]
        if stops.keys() & {*trials} and all(len(records.get(x, ())) >= search["repeats"] for x in trials):
            stopped = [stops[trial] for trial in trials if trial in stops]
            going = [trial for trial in trials if trial not in stops]
            first = {"epochs": rungs[0], "trials": trials, "stopped": []}
            last = {"epochs": None, "trials": going, "stopped": stopped}
            yield f"racing/{batch:05d}", [first, last]
    drawn = [trial for trial in stops if records[trial][0].finished]
    if drawn and len(drawn) >= search["racing"]["audit"]:
        yield racing.AUDIT, {"designs": len(entries), "trials": drawn}


def _stop(record: RunRecord, rungs: Sequence[int]) -> dict[str, Any] | None:
    """Return how racing stopped the trial of a record: it stood at no later rung; None: it did not."""
    epochs, stood = record.stopped_at_epoch, max(record.rungs, default=0)
    if epochs is None and record.finished and stood:
        ends = record.sections["training"]["epochs"]
        epochs = stood if any(stood < rung < ends for rung in rungs) else None
    if epochs is None:
        return None
    reason = record.reason or "an audit has trained it on"
    return {"trial": record.trial, "epochs": epochs, "reason": reason}
