"""Opening the book of a study to write it; a damaged one is restored from its copy.

Where the copy is damaged too, the records of runs name their designs. What they do not say is
lost: the queue, and what racing has decided. The sampler proposes again what they do not name.

The folder of a study as versions up to 0.9 wrote it is made one of today; figures stay bit for bit. Then a
run was a folder `artefacts/<trial>/repeat_<k>/` of record.json and arrays, the designs were an Optuna
journal, and each further thing a JSON file. Checkpoints are not taken over: their trainings begin again.
"""

from __future__ import annotations

import contextlib
import hashlib
import itertools
import json
import os
import re
import shutil
import time
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dse import store
from dse.store import BOOK, COPY, Book, Damaged, StoreError
from dse.study import held, precision
from dse.study.ledger import Entry
from dse.study.results import EARLIER

if TYPE_CHECKING:
    import optuna

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


_JOURNAL, _ENVIRONMENT, _ARTEFACTS = EARLIER
_OLD = (
    _JOURNAL,
    _ENVIRONMENT,
    "warnings.json",
    "audit.json",
    "views.json",
    "front_repeats.json",
)
_OLD_FOLDERS = (_ARTEFACTS, "queue", "racing", "checkpoints")
_LIMIT = "constraints:"
# The SHA-256 of a file with zeros for its digits, near the beginning of a JSON file.
_SEAL = re.compile(rb"dse-sha256:([0-9a-f]{64})")
_BEGINNING = 512
# Keys of a search space that are gone: what ends a search changes no result, nor does who shares its designs.
_STOP, _STORAGE = re.compile(r"\bstop: \{[^}]*\}"), re.compile(r"\s+storage:\s[^,}]*,")


def is_earlier(folder: Path) -> bool:
    """Return whether an earlier version wrote the folder of a study."""
    return any((folder / name).exists() for name in EARLIER)


def damaged_runs(folder: Path) -> dict[Path, str]:
    """Return folder of a run that cannot be taken over -> what is wrong with it, in words."""
    faults = {}
    for old in _old_runs(folder):
        try:
            _record(old)
        except (StoreError, OSError, LookupError, ValueError, TypeError) as error:
            faults[old] = f"is damaged ({str(error).splitlines()[0]})"
    return faults


def convert(folder: Path) -> list[str]:
    """Make the folder of an earlier version one of today; return what could not be taken over.

    Args:
        folder: of the study, which the caller has locked.

    Raises:
        StoreError: the search space cannot be read, or the folder cannot be written.
    """
    damaged = damaged_runs(folder)
    documents = (
        *(folder / name for name in _OLD[1:]),
        *folder.glob("queue/*.json"),
        *folder.glob("racing/*.json"),
    )
    damaged |= {path: "is damaged" for path in documents if path.is_file() and _read(path) is None}
    intact = [old for old in _old_runs(folder) if old not in damaged]
    runs = [path for old in intact for path in _run(folder, old)]
    notes = [f"{old}: {fault}; it is moved aside" for old, fault in damaged.items()]
    tables = {
        "study": [
            {"name": name, "content": content}
            for name, content in (
                (store.ENVIRONMENT, _read(folder / _ENVIRONMENT)),
                (store.WARNINGS, _read(folder / "warnings.json")),
                ("audit", _read(folder / "audit.json")),
                ("racing/audit", _read(folder / "racing/audit.json")),
                *((f"racing/{x.stem}", _read(x, "rounds")) for x in folder.glob("racing/[0-9]*.json")),
            )
            if content is not None
        ],
        "trial": [entry.row() for entry in _entries(folder / _JOURNAL)],
        "queue": [
            {"place": place, "design": _read(path, "design")}
            for place, path in enumerate(sorted(folder.glob("queue/*.json")), start=1)
        ],
    }
    with store.Book(folder, writes=True) as book, book.together():
        for table, rows in tables.items():
            book.put(table, rows)
        store.note_files(book, runs)
    for path in (folder / store.SPACE, *folder.glob("hardware/*.yaml"), *folder.glob("plugins/*.py")):
        text = path.read_text(encoding="utf-8")
        text = text.partition("\n")[2] if text.startswith("# dse-sha256:") else text
        store.write_text(path, _STOP.sub("stop: null", _STORAGE.sub("", text)))
    for name in (held.TRIALS, held.POINTS):
        if (folder / name).is_file():
            _table(folder / name)
    for old in damaged:
        store.set_aside(folder, old)
    for name in (*_OLD, *_OLD_FOLDERS):
        store.remove(folder / name)
    return notes


def _read(path: Path, member: str | None = None) -> Any:
    """Return the content of a JSON file, or a member of it; None: there is none, or its seal is broken."""
    content = path.read_bytes() if path.is_file() else b""
    if (seal := _SEAL.search(content, 0, _BEGINNING)) is not None:
        begin, end = seal.span(1)
        blank = content[:begin] + b"0" * (end - begin) + content[end:]
        if hashlib.sha256(blank).hexdigest().encode() != seal[1]:
            return None
    with contextlib.suppress(ValueError):
        document = json.loads(content)
        if isinstance(document, dict):
            document.pop("seal", None)
            document = document["rows"] if document.keys() == {"rows"} else document
        return document if member is None else document.get(member)
    return None


def _arrays(path: Path) -> dict[str, Any]:
    with np.load(path, allow_pickle=False) as archive:
        return {name: archive[name] for name in archive.files}


def _old_runs(folder: Path) -> list[Path]:
    return sorted(folder.glob(f"{_ARTEFACTS}/*/repeat_*"))


def _record(old: Path) -> dict[str, Any]:
    """Return the record of a run whose files are what was written."""
    record: dict[str, Any] | None = _read(old / store.RECORD)
    if record is None:
        raise ValueError("its record cannot be read")
    if (old.parent.name, old.name) != (f"{record['trial']:05d}", f"repeat_{record['repeat']}"):
        raise ValueError("its record is that of another run")
    for name, digest in record["files"].items():
        if store.checksum(old / name) != digest:
            raise ValueError(f"{name} is not what was written")
    return record


def _run(folder: Path, old: Path) -> list[Path]:
    """Write the archive of an intact run, and its evaluations at other precisions; return the files."""
    record = _record(old)
    run = store.run_file(folder, record["trial"], record["repeat"])
    kept = {key: x for key, x in record.items() if key not in ("schema", "files")}
    store.save_run(run, kept, {name: _arrays(old / name) for name in record["files"]}, replaces=True)
    files = [run]
    for path in sorted(old.glob("precision_*.npz")):
        arrays = _arrays(path)
        arrays |= {"trial": np.array(record["trial"]), "repeat": np.array(record["repeat"])}
        target = precision.file_of(run, (int(arrays["weight_bits"]), float(arrays["pruned"])))
        with store.published(target) as temporary:
            store.save_arrays(temporary, arrays)
        files.append(target)
    return files


def _table(path: Path) -> None:
    """Write a table again with the digests that the book has of its runs."""
    import pyarrow.parquet

    table = pyarrow.parquet.read_table(path)
    made_from = json.loads(store.made_from(path) or "{}")
    if "digests" in made_from:
        made_from["digests"] = held.digests(path.parent, store.runs_in(path.parent))
    with store.noted(path) as temporary:
        with store.parquet(temporary, table.schema, json.dumps(made_from)) as writer:
            writer.write_table(table)


def _entries(path: Path) -> list[Entry]:
    """Return the designs of a journal in the order of proposal; none where it is damaged."""
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend

    if not path.is_file():
        return []
    try:
        storage = JournalStorage(JournalFileBackend(str(path)))
        trials = [x for study in storage.get_all_studies() for x in storage.get_all_trials(study._study_id)]
    except (ValueError, LookupError, TypeError, OSError):
        return []
    return [_entry(trial) for trial in trials]


def _entry(trial: optuna.trial.FrozenTrial) -> Entry:
    about, proposed_s = trial.user_attrs, _seconds(trial.datetime_start)
    excluded = about.get("excluded", "")
    return Entry(
        trial=trial.number,
        batch=int(about["batch"]),
        design=about["design"],
        proposed_s=proposed_s or 0.0,
        reported_s=_seconds(trial.datetime_complete) or (proposed_s if excluded else None),
        values=None if trial.values is None else tuple(map(float, trial.values)),
        excluded=excluded,
        enqueued=bool(about.get("enqueued")),
        violations={
            name.removeprefix(_LIMIT): float(x)
            for name, x in trial.system_attrs.items()
            if name.startswith(_LIMIT)
        },
        at_rungs=trial.intermediate_values,
        stopped=trial.state.name == "PRUNED" and not excluded,
    )


def _seconds(moment: datetime | None) -> float | None:
    """Return seconds since 1970 of a moment as Optuna has it: local, without a time zone."""
    return None if moment is None else moment.timestamp()
