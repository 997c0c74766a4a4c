"""One training run on disk: record.json, and a checksum of every file beside it."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import dse
from dse.store.files import checksum, published, read_json, write_sealed_json
from dse.store.sealed import StoreError, check_kind, damaged, unreadable

SCHEMA = 1
RECORD = "record.json"


def run_folder(study: Path, trial: int, repeat: int) -> Path:
    """Return the folder of one training run."""
    return study / "artefacts" / f"{trial:05d}" / f"repeat_{repeat}"


def runs_in(study: Path) -> dict[int, list[int]]:
    """Return trial -> repeats of the runs that a study's folder holds, by the names of their folders."""
    runs: dict[int, list[int]] = {}
    for trial, at in _numbered(study / "artefacts", "", 5):
        repeats = [n for n, run in _numbered(at, "repeat_", 1) if os.path.lexists(f"{run}/{RECORD}")]
        if repeats:
            runs[trial] = sorted(repeats)
    return dict(sorted(runs.items()))


def _numbered(folder: Path | str, prefix: str, n_digits: int) -> list[tuple[int, str]]:
    """Return (number, path) of the entries of a folder whose names are a prefix and a number."""
    try:
        names = os.listdir(folder)
    except OSError:
        return []
    of = {name: name.removeprefix(prefix) for name in names if name.startswith(prefix)}
    numbers = {name: int(n) for name, n in of.items() if n.isascii() and n.isdigit()}
    return [(n, f"{folder}/{x}") for x, n in numbers.items() if x == f"{prefix}{n:0{n_digits}d}"]


def save_run(
    folder: Path,
    record: Mapping[str, Any],
    files: Mapping[str, Callable[[Path], None]],
    *,
    replaces: bool = False,
) -> None:
    """Publish one training run: its files, and record.json with a checksum of each.

    Args:
        folder: from `run_folder`.
        record: what record.json holds beside the schema and the checksums.
        files: name -> function that writes the file at the path it is given.
        replaces: whether a run that is there gives way, once this one is written.
    """
    identity = {"schema": SCHEMA, "version": dse.__version__, "study": folder.parents[2].name}
    with published(folder, replaces=replaces) as temporary:
        temporary.mkdir()
        checksums = {}
        for name, write in files.items():
            write(temporary / name)
            checksums[name] = checksum(temporary / name)
        write_sealed_json(temporary / RECORD, {**identity, **record, "files": checksums})


def read_record(folder: Path) -> dict[str, Any]:
    """Return the record of the run in a folder without reading the files that it names.

    Raises:
        Damaged: it is missing, damaged, or that of another run.
        StoreError: it is of a newer schema, or cannot be read now.
    """
    path = folder / RECORD
    record = read_json(path)
    if not isinstance(record, dict) or not isinstance(record.get("files"), dict):
        raise damaged(path, "is not the record of a run")
    schema = record.get("schema", 0)
    if type(schema) is int and schema > SCHEMA:
        raise StoreError(
            f"{path}: schema {schema} is newer than {SCHEMA}, the schema that this version of dse reads; "
            "install a newer version"
        )
    trial, repeat = record.get("trial"), record.get("repeat")
    if (
        not (type(trial) is int and type(repeat) is int)
        or folder.parts[-2:] != run_folder(folder, trial, repeat).parts[-2:]
    ):
        raise damaged(path, f"is the record of trial {trial!r} repeat {repeat!r}")
    return record


def load_run(folder: Path) -> dict[str, Any] | None:
    """Return a finished run's record, or None where there is no such run.

    Raises:
        Damaged: as in `read_record`, or a file that the record names is damaged or missing.
        StoreError: as in `read_record`, or a file cannot be read now.
    """
    if not folder.is_dir():
        return None
    record = read_record(folder)
    for name, expected in record["files"].items():
        if _digest(folder / name) != expected:
            raise damaged(folder / name, "is damaged (its checksum differs)")
    return record


def _digest(path: Path) -> str:
    try:
        check_kind(path)  # a pipe would never end
        return checksum(path)
    except OSError as error:
        raise unreadable(path, error) from None
