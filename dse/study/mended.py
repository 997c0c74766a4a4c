"""Opening the book of a study to write it; a damaged one is restored from its copy.

Where the copy is damaged too, the records of runs name their designs. What they do not say is
lost: the queue, and what racing has decided. The sampler proposes again what they do not name.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import shutil
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from dse import store
from dse.store import BOOK, COPY, Book, Damaged, StoreError
from dse.study import held
from dse.study.earlier import convert
from dse.study.ledger import Entry
from dse.study.results import is_earlier

_COMPARED = 5


@contextlib.contextmanager
def opened(folder: Path, batch: int = 1) -> Iterator[tuple[Book, list[str]]]:
    """Yield the book of a study to write it, and what was damaged and is mended, in sentences.

    Args:
        folder: of the study, which the caller has locked.
        batch: designs that its search proposes at a time.
    """
    notes = convert(folder) if is_earlier(folder) else []
    notes += _restored(folder, batch)
    with Book(folder, writes=True, is_session=True) as book:
        yield book, notes
        store.back_up(book)


def fault(folder: Path, name: str = BOOK) -> str:
    """Return what is wrong with the book of a study, in words; '' if it can be read and names every run.

    Args:
        folder: of the study.
        name: of the book, or of its copy, which may be older than the runs.

    Raises:
        StoreError: it cannot be read now.
    """
    try:
        with Book(folder, name) as book:
            tables = book.everything()
    except Damaged as error:
        return str(error).removeprefix(f"{folder / name}: ").removesuffix(f"; {store.REMEDY}")
    trials = [row["trial"] for row in tables["trial"]]
    if trials != list(range(len(trials))):
        return "lacks a design"
    if not _knows_runs(folder, {row["name"]: row["sha256"] for row in tables["file"]}):
        return "is the book of another study"
    has_more = name == BOOK and _design(folder, len(trials)) is not None
    return f"lacks trial {len(trials)}, which has a run" if has_more else ""


def _knows_runs(folder: Path, digests: Mapping[str, str]) -> bool:
    """Return whether one of the first runs is as a book says; True where it says nothing of two of them."""
    runs = (store.run_file(folder, *x) for x in itertools.islice(_numbers(folder), _COMPARED))
    known = {run: digests[name] for run in runs if (name := f"{store.RUNS}/{run.name}") in digests}
    return len(known) < 2 or any(store.checksum(run) == digest for run, digest in known.items())


def _numbers(folder: Path) -> Iterator[tuple[int, int]]:
    """Yield trial and repeat of every run in a folder."""
    yield from ((trial, repeat) for trial, of in store.runs_in(folder).items() for repeat in of)


def _restored(folder: Path, batch: int) -> list[str]:
    """Write a damaged book anew, and say so; a whole one stays, and a study that begins has none."""
    path, copy = folder / BOOK, folder / COPY
    is_begun = os.path.lexists(path) or os.path.lexists(copy) or store.runs_in(folder)
    if not is_begun or not (what := fault(folder)):
        return []
    of_copy = fault(folder, COPY)
    if os.path.lexists(path):
        store.set_aside(folder, path)
        what += f" (it is now {path.name}.damaged)"
    for of_sqlite in ("-journal", "-wal", "-shm"):
        store.remove(path.with_name(f"{path.name}{of_sqlite}"))
    if not of_copy:
        with store.published(path) as temporary:
            shutil.copyfile(copy, temporary)
        return [f"{path}: {what}: it is restored from {COPY}"]
    if "another study" in what:
        store.remove(folder / store.SPACE)  # it may have come with the book
    for table in (held.TRIALS, held.POINTS):
        store.remove(folder / table)  # nothing tells any more whether it is what was written
    entries: list[Entry] = []
    while (design := _design(folder, len(entries))) is not None:
        entries.append(_next(entries, design, batch))
    with Book(folder, writes=True) as book:
        book.put("trial", [entry.row() for entry in entries])
    return [
        f"{path}: {what}, and {COPY} {of_copy}: it is written anew with {len(entries)} trials, which the "
        "records of runs name; the queue and what racing decided are lost"
    ]


def _design(folder: Path, trial: int) -> Mapping[str, object] | None:
    """Return the design of a trial by the record of one of its runs; None where none can be read."""
    for run in store.runs_of(folder, trial):
        with contextlib.suppress(StoreError):
            design = store.read_record(run).get("design")
            if isinstance(design, dict):
                return design
    return None


def _next(before: Sequence[Entry], design: Mapping[str, object], size: int) -> Entry:
    """Return the entry of a design after others, of batches of a size."""
    batch = before[-1].batch if before else 0
    is_full = sum(entry.batch == batch for entry in before) >= size
    return Entry(len(before), batch + is_full, design, time.time())
