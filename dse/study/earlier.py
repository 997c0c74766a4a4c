"""The folder of a study as versions up to 0.9 wrote it, made one of today; figures stay bit for bit.

Then a run was a folder `artefacts/<trial>/repeat_<k>/` of record.json and arrays, the designs were an Optuna
journal, and each further thing a JSON file. `dse run` makes tables and checkpoints again.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from dse import store
from dse.study import held
from dse.study.ledger import Entry
from dse.study.results import EARLIER

_JOURNAL, _ENVIRONMENT, _ARTEFACTS = EARLIER
_REMOVED = (_JOURNAL, _ENVIRONMENT, _ARTEFACTS, "racing", "checkpoints", held.TRIALS, held.POINTS)
# The SHA-256 of a file with zeros for its digits, near the beginning of a JSON file.
_SEAL = re.compile(rb"dse-sha256:([0-9a-f]{64})")
# Keys of a search space that are gone: what ends a search changes no result, nor does who shares its designs.
_STOP, _STORAGE = re.compile(r"\bstop: \{[^}]*\}"), re.compile(r"\s+storage:\s[^,}]*,")


def convert(folder: Path) -> list[str]:
    """Make the folder of an earlier version, which the caller has locked, one of today; return its damage."""
    damaged: dict[Path, str] = {}

    @contextlib.contextmanager
    def reading(path: Path) -> Iterator[None]:
        try:
            yield
        except (store.StoreError, OSError, LookupError, ValueError, TypeError) as error:
            damaged[path] = str(error).splitlines()[0]

    runs, documents = [], dict[str, Any]()
    for old in sorted(folder.glob(f"{_ARTEFACTS}/*/repeat_*")):
        with reading(old):
            runs.append(_run(folder, old))
    sources = {store.ENVIRONMENT: _ENVIRONMENT, store.WARNINGS: "warnings.json", "audit": "audit.json"}
    rounds = {f"racing/{x.stem}": f"racing/{x.name}" for x in folder.glob("racing/*.json")}
    for name, file in (sources | rounds).items():
        if (folder / file).is_file():
            with reading(folder / file):
                content = _read(folder / file)
                documents[name] = content.get("rounds", content) if name in rounds else content
    with store.Book(folder, writes=True) as book, book.together():
        book.put("study", [{"name": name, "content": x} for name, x in documents.items()])
        with reading(folder / _JOURNAL):
            book.put("trial", [entry.row() for entry in _entries(folder / _JOURNAL)])
        store.note_files(book, runs)
    for path in (folder / store.SPACE, *folder.glob("hardware/*.yaml"), *folder.glob("plugins/*.py")):
        text = path.read_text(encoding="utf-8")
        text = text.partition("\n")[2] if text.startswith("# dse-sha256:") else text
        store.write_text(path, _STOP.sub("stop: null", _STORAGE.sub("", text)))
    for old in damaged:
        store.set_aside(folder, old)
    for name in (*_REMOVED, *sources.values()):
        store.remove(folder / name)
    return [f"{old}: is damaged ({fault}); it is moved aside" for old, fault in damaged.items()]


def _read(path: Path) -> Any:
    """Return the content of a JSON file whose seal, if it has one, is whole."""
    content = path.read_bytes()
    if (seal := _SEAL.search(content, 0, 512)) is not None:
        blank = content[: seal.start(1)] + b"0" * 64 + content[seal.end(1) :]
        if hashlib.sha256(blank).hexdigest().encode() != seal[1]:
            raise ValueError("it is not what was written")
    document = json.loads(content)
    if isinstance(document, dict):
        document.pop("seal", None)
    return document["rows"] if isinstance(document, dict) and document.keys() == {"rows"} else document


def _run(folder: Path, old: Path) -> Path:
    """Write the archive of a run; return its file."""
    record = _read(old / store.RECORD)
    for name, digest in record["files"].items():
        if store.checksum(old / name) != digest:
            raise ValueError(f"{name} is not what was written")
    run = store.run_file(folder, record["trial"], record["repeat"])
    kept = {key: x for key, x in record.items() if key not in ("schema", "files")}
    store.save_run(run, kept, {name: dict(np.load(old / name)) for name in record["files"]}, replaces=True)
    return run


def _entries(path: Path) -> Iterator[Entry]:
    """Yield the designs of a journal in the order of proposal."""
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend

    storage = JournalStorage(JournalFileBackend(str(path)))
    for trial in (x for study in storage.get_all_studies() for x in storage.get_all_trials(study._study_id)):
        about, moments = trial.user_attrs, (trial.datetime_start, trial.datetime_complete)  # in local time
        proposed_s, reported_s = (None if x is None else x.timestamp() for x in moments)
        excluded = about.get("excluded", "")
        yield Entry(
            trial=trial.number,
            batch=int(about["batch"]),
            design=about["design"],
            proposed_s=proposed_s or 0.0,
            reported_s=reported_s or (proposed_s if excluded else None),
            values=None if trial.values is None else tuple(map(float, trial.values)),
            excluded=excluded,
            enqueued=bool(about.get("enqueued")),
            at_rungs=trial.intermediate_values,
            stopped=trial.state.name == "PRUNED" and not excluded,
        )
