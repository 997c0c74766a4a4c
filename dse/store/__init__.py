"""The folder of a study, written so that a crash at any moment leaves either the old or the new, never half.

    results/<study>/
        study.sqlite        the book (dse.store.book): designs, how they ended, notes, sessions, digests;
                            study.sqlite.copy is a copy of it
        search_space.yaml   what is explored, fully resolved
        runs/<trial>-<repeat>.npz   one training run: its record and arrays (dse.store.runs)
        precision/<trial>-<repeat>/   what it measured at other precisions (dse.study.precision)
        trials.parquet, points.parquet, page.html
        plugins/            copies of its plugins' files    hardware/   its hardware profiles
        coordinators/       who works on it now (dse.study.coordinators)
        checkpoints/        where unfinished trainings stand (dse.study.checkpoints)
        bundles/<name>/     exported designs: the page shows their verdicts (dse.dashboard.verdicts)
        *.damaged           what `dse doctor --repair` has moved aside, laid out as it was

The book has the SHA-256 of every other file, so that a change of any byte, or a file of another study, is
an error when it is read. A file is written under a temporary name, flushed to the disk, and renamed: that of
a run is therefore either complete or absent, and its presence is what makes the run finished.
"""

from dse.store.arrays import (
    DAMAGED_ARCHIVE,
    RECORD,
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
from dse.store.book import (
    BOOK,
    COPY,
    Book,
    digests,
    document,
    keep,
)
from dse.store.errors import (
    ENVIRONMENT,
    REMEDY,
    SPACE,
    WARNINGS,
    Damaged,
    InUse,
    StoreError,
    damaged,
    unreadable,
)
from dse.store.files import (
    COORDINATORS,
    TEMPORARY,
    atomic,
    back_up,
    checksum,
    exclusive,
    explained,
    is_held,
    is_temporary,
    known_as,
    living,
    noted,
    published,
    read_bytes,
    read_json,
    read_text,
    remove,
    set_aside,
    sweep,
    verify,
    write_json,
    write_text,
)
from dse.store.plain import (
    heads_document,
    heads_of,
    plain,
    plain_cell,
)
from dse.store.runs import (
    RUNS,
    SCHEMA,
    load_run,
    named,
    note_files,
    read_record,
    record_in,
    run_file,
    runs_in,
    runs_of,
    save_run,
)
from dse.store.tables import (
    made_from,
    parquet,
    write_table,
)

__all__ = [
    "BOOK",
    "COORDINATORS",
    "COPY",
    "DAMAGED_ARCHIVE",
    "ENVIRONMENT",
    "RECORD",
    "REMEDY",
    "RUNS",
    "SCHEMA",
    "SPACE",
    "TEMPORARY",
    "WARNINGS",
    "Book",
    "Damaged",
    "InUse",
    "StoreError",
    "atomic",
    "back_up",
    "checksum",
    "damaged",
    "digests",
    "document",
    "exclusive",
    "explained",
    "fitted_of",
    "heads_document",
    "heads_of",
    "is_held",
    "is_temporary",
    "keep",
    "known_as",
    "living",
    "load_arrays",
    "load_run",
    "made_from",
    "named",
    "note_files",
    "noted",
    "parquet",
    "plain",
    "plain_cell",
    "published",
    "read_bytes",
    "read_json",
    "read_record",
    "read_text",
    "record_arrays",
    "record_in",
    "record_of",
    "remove",
    "response_arrays",
    "response_of",
    "run_file",
    "runs_in",
    "runs_of",
    "save_arrays",
    "save_run",
    "set_aside",
    "sweep",
    "unreadable",
    "verify",
    "work_arrays",
    "work_of",
    "write_json",
    "write_table",
    "write_text",
]
