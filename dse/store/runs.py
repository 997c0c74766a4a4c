"""One training run on disk: an archive of its record and its arrays, `runs/<trial>-<repeat>.npz`.

The archive is what a run is: its presence makes the run finished, and the book of the study has its digest.
"""

from __future__ import annotations

import json
import os
import re
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import dse
from dse.base.records import Array
from dse.store.arrays import DAMAGED_ARCHIVE, RECORD, save_arrays
from dse.store.book import Book
from dse.store.errors import StoreError, check_kind, damaged, unreadable
from dse.store.files import checksum, known_as, published, verify
from dse.store.plain import plain

SCHEMA = 2
RUNS = "runs"
_RUN = re.compile(r"(\d{5})-(\d+)\.npz")


def run_file(study: Path, trial: int, repeat: int) -> Path:
    """Return the archive of one training run."""
    return study / RUNS / f"{trial:05d}-{repeat}.npz"


def named(path: Path) -> tuple[int, int] | None:
    """Return trial and repeat of the archive of a run, or of one in its folder; None: it is none."""
    match = _RUN.fullmatch(path.name) or _RUN.fullmatch(f"{path.parent.name}.npz")
    return None if match is None else (int(match[1]), int(match[2]))


def runs_in(study: Path) -> dict[int, list[int]]:
    """Return trial -> repeats of the runs that a study's folder holds, by the names of their files."""
    try:
        names = sorted(os.listdir(study / RUNS))
    except OSError:
        return {}
    runs: dict[int, list[int]] = {}
    for match in filter(None, map(_RUN.fullmatch, names)):
        runs.setdefault(int(match[1]), []).append(int(match[2]))
    return {trial: sorted(repeats) for trial, repeats in runs.items()}


def runs_of(study: Path, trial: int) -> list[Path]:
    """Return the archives of a trial's runs, repeat 0 first."""
    return [run_file(study, trial, repeat) for repeat in runs_in(study).get(trial, ())]


def first_run(study: Path, trial: int) -> Path:
    """Return the archive of a trial's first run; of a search that was stopped it need not be repeat 0."""
    return next(iter(runs_of(study, trial)), run_file(study, trial, 0))


def save_run(
    path: Path,
    record: Mapping[str, Any],
    parts: Mapping[str, Mapping[str, Array]],
    *,
    replaces: bool = False,
    compressed: bool = True,
) -> None:
    """Publish one training run: its record and the arrays of its parts.

    Args:
        path: from `run_file`.
        record: what the record holds beside the schema and the names of the parts.
        parts: name, such as weights.npz -> its arrays.
        replaces: whether a run that is there gives way, once this one is written.
        compressed: whether the arrays are.
    """
    if path.exists() and not replaces:
        return
    about = {"schema": SCHEMA, "version": dse.__version__, "study": path.parents[1].absolute().name}
    document = {**about, **record, "files": list(parts)}
    arrays = {f"{Path(x).stem}/{name}": array for x, of in parts.items() for name, array in of.items()}
    with published(path) as temporary:
        save_arrays(temporary, arrays, compressed=compressed)
        with zipfile.ZipFile(temporary, "a", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr(zipfile.ZipInfo(RECORD), json.dumps(document, default=plain))


def record_in(path: Path) -> dict[str, Any]:
    """Return the record in an archive, of whichever run it is.

    Raises:
        Damaged: it is missing, damaged, or no run.
        StoreError: it cannot be read now.
    """
    try:
        check_kind(path)
        with zipfile.ZipFile(path) as archive:
            record = json.loads(archive.read(RECORD))
    except OSError as error:
        raise unreadable(path, error) from None
    except (*DAMAGED_ARCHIVE, RecursionError) as error:
        raise damaged(path, f"cannot be read: {error}") from None
    if not isinstance(record, dict) or not isinstance(record.get("files"), list):
        raise damaged(path, "is not a run")
    return record


def read_record(path: Path) -> dict[str, Any]:
    """Return the record of a run without reading its arrays.

    Raises:
        Damaged: it is missing, damaged, or that of another run.
        StoreError: it is of a newer schema, or cannot be read now.
    """
    record = record_in(path)
    schema = record.get("schema", 0)
    if type(schema) is int and schema > SCHEMA:
        raise StoreError(
            f"{path}: schema {schema} is newer than {SCHEMA}, the schema that this version of dse reads; "
            "install a newer version"
        )
    if (record.get("trial"), record.get("repeat")) != named(path):
        raise damaged(path, f"is trial {record.get('trial')!r} repeat {record.get('repeat')!r}")
    return record


def load_run(path: Path) -> dict[str, Any] | None:
    """Return a finished run's record, or None where there is no such run.

    The archive is checked against the book of the study; a run that the book does not know yet, by the
    checksums in the archive.

    Raises:
        Damaged: as in `read_record`, or the archive is not what was written.
        StoreError: as in `read_record`.
    """
    if not os.path.lexists(path):
        return None
    record = read_record(path)
    if known_as(path):
        verify(path)
        return record
    try:
        with zipfile.ZipFile(path) as archive:
            if wrong := archive.testzip():
                raise damaged(path, f"is damaged ({wrong} is not what was written)")
    except OSError as error:
        raise unreadable(path, error) from None
    except DAMAGED_ARCHIVE as error:
        raise damaged(path, f"cannot be read: {error}") from None
    return record


def note_files(book: Book, paths: list[Path]) -> None:
    """Note the digests of files of a study that are as they should be; those that are gone are forgotten."""
    names = {path.relative_to(book.folder).as_posix(): path for path in paths}
    with book.together():
        for name, path in names.items():
            if path.is_file():
                book.put("file", [{"name": name, "sha256": checksum(path), "before": ""}])
            else:
                book.drop("file", "name = ?", name)
