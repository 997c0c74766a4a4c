"""Files of a study, written so that a crash at any moment leaves either the old or the new, never half.

    results/<study>/
        search_space.yaml   what is explored, fully resolved       environment.json   where it ran
        journal.log         the ledger (dse.study.ledger)   trials.parquet, points.parquet, page.html
        warnings.json       what is suspicious about the recordings
        audit.json          what could pass for skill in them (dse.audit), if they have been audited
        plugins/            copies of its plugins' files    hardware/   its hardware profiles
        artefacts/<trial>/repeat_<k>/   one training run: record.json and the arrays that it names,
            and precision_*.npz, what it measured at other precisions

A file or a folder is written under a temporary name, flushed to the disk, and renamed. A run's folder is
therefore either complete or absent, and its presence is what makes the run finished.
"""

from dse.store.arrays import (
    DAMAGED_ARCHIVE,
    fitted_of,
    load_arrays,
    record_arrays,
    record_of,
    response_arrays,
    response_of,
    save_arrays,
    work_arrays,
    work_of,
)
from dse.store.files import (
    WARNINGS,
    StoreError,
    atomic,
    checksum,
    exclusive,
    explained,
    is_temporary,
    published,
    read_json,
    remove,
    sweep,
    write_json,
    write_text,
)
from dse.store.plain import heads_document, heads_of, plain, plain_cell
from dse.store.runs import SCHEMA, load_run, run_folder, save_run

__all__ = [
    "DAMAGED_ARCHIVE",
    "SCHEMA",
    "WARNINGS",
    "StoreError",
    "atomic",
    "checksum",
    "exclusive",
    "explained",
    "fitted_of",
    "heads_document",
    "heads_of",
    "is_temporary",
    "load_arrays",
    "load_run",
    "plain",
    "plain_cell",
    "published",
    "read_json",
    "record_arrays",
    "record_of",
    "remove",
    "response_arrays",
    "response_of",
    "run_folder",
    "save_arrays",
    "save_run",
    "sweep",
    "work_arrays",
    "work_of",
    "write_json",
    "write_text",
]
