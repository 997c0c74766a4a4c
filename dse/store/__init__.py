"""Files of a study, written so that a crash at any moment leaves either the old or the new, never half.

    results/<study>/
        search_space.yaml   what is explored, fully resolved       environment.json   where it ran
        journal.log         the ledger (dse.study.ledger)   trials.parquet, points.parquet, page.html
        notes.json          notes and pins on designs    views.json    saved views of the page
        warnings.json       what is suspicious about the recordings
        audit.json          what could pass for skill in them (dse.audit), if they have been audited
        plugins/            copies of its plugins' files    hardware/   its hardware profiles
        artefacts/<trial>/repeat_<k>/   one training run: record.json and the arrays that it names,
            and precision_*.npz, what it measured at other precisions
        checkpoints/        where unfinished trainings stand (dse.study.checkpoints)
        racing/             which designs stopped early, and the audit of that (dse.study.racing)
        bundles/<name>/     exported designs: the page shows their verdicts (dse.dashboard.verdicts)
        front_repeats.json  which designs were repeated because their place on the front was undecided

Every file but the journal and what plugins are copied from is sealed (`dse.store.sealed`): a change of any
byte, or of the seal, or a file of another study, is an error when it is read. The journal has a checksum per
line (`dse.study.lines`).

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
    seal_archive,
    work_arrays,
    work_of,
)
from dse.store.files import (
    TEMPORARY,
    WARNINGS,
    atomic,
    checksum,
    exclusive,
    explained,
    is_temporary,
    published,
    read_json,
    read_or_remove,
    read_sealed_text,
    remove,
    sweep,
    write_json,
    write_sealed_json,
    write_sealed_text,
    write_text,
)
from dse.store.plain import heads_document, heads_of, plain, plain_cell
from dse.store.runs import RECORD, SCHEMA, load_run, read_record, run_folder, runs_in, save_run
from dse.store.sealed import (
    ENVIRONMENT,
    JOURNAL,
    REMEDY,
    SPACE,
    Damaged,
    StoreError,
    damaged,
    identity,
    is_sealed,
    new_identity,
    read_bytes,
    requires_seal,
    unreadable,
    verify,
    witnessed,
)
from dse.store.tables import made_from, parquet, write_table

__all__ = [
    "DAMAGED_ARCHIVE",
    "ENVIRONMENT",
    "JOURNAL",
    "RECORD",
    "REMEDY",
    "SCHEMA",
    "SPACE",
    "TEMPORARY",
    "WARNINGS",
    "Damaged",
    "StoreError",
    "atomic",
    "checksum",
    "damaged",
    "exclusive",
    "explained",
    "fitted_of",
    "heads_document",
    "heads_of",
    "identity",
    "is_sealed",
    "is_temporary",
    "load_arrays",
    "load_run",
    "made_from",
    "new_identity",
    "parquet",
    "plain",
    "plain_cell",
    "published",
    "read_bytes",
    "read_json",
    "read_or_remove",
    "read_record",
    "read_sealed_text",
    "record_arrays",
    "record_of",
    "remove",
    "requires_seal",
    "response_arrays",
    "response_of",
    "run_folder",
    "runs_in",
    "save_arrays",
    "save_run",
    "seal_archive",
    "sweep",
    "unreadable",
    "verify",
    "witnessed",
    "work_arrays",
    "work_of",
    "write_json",
    "write_sealed_json",
    "write_sealed_text",
    "write_table",
    "write_text",
]
