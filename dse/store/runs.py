"""One training run on disk: record.json, and a checksum of every file beside it."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from dse.store.files import StoreError, checksum, published, read_json
from dse.store.plain import plain

SCHEMA = 1


def run_folder(study: Path, trial: int, repeat: int) -> Path:
    """Return the folder of one training run."""
    return study / "artefacts" / f"{trial:05d}" / f"repeat_{repeat}"


def save_run(folder: Path, record: Mapping[str, Any], files: Mapping[str, Callable[[Path], None]]) -> None:
    """Publish one training run: its files, and record.json with a checksum of each.

    Args:
        folder: from `run_folder`.
        record: what record.json holds beside the schema and the checksums.
        files: name -> function that writes the file at the path it is given.
    """
    with published(folder) as temporary:
        temporary.mkdir()
        checksums = {}
        for name, write in files.items():
            write(temporary / name)
            checksums[name] = checksum(temporary / name)
        document = {"schema": SCHEMA, **record, "files": checksums}
        (temporary / "record.json").write_text(
            json.dumps(document, indent=1, default=plain), encoding="utf-8"
        )


def load_run(folder: Path) -> dict[str, Any] | None:
    """Return a finished run's record, or None where there is no such run.

    Raises:
        StoreError: the record or a file that it names is damaged, missing, or of a newer schema.
    """
    if not folder.is_dir():
        return None
    record = read_json(folder / "record.json")
    if not isinstance(record, dict) or not isinstance(record.get("files"), dict):
        raise StoreError(f"{folder / 'record.json'}: is not the record of a run")
    if record.get("schema", 0) > SCHEMA:
        raise StoreError(
            f"{folder / 'record.json'}: schema {record['schema']} is newer than {SCHEMA}, the schema that "
            "this version of dse reads"
        )
    for name, expected in record["files"].items():
        if not (folder / name).is_file():
            raise StoreError(f"{folder / name}: is missing")
        if checksum(folder / name) != expected:
            raise StoreError(f"{folder / name}: is damaged (its checksum differs)")
    return record
