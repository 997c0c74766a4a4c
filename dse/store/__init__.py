"""The folder of a study, written so that a crash at any moment leaves either the old or the new, never half.

    results/<study>/
        study.sqlite        the book (dse.store.book): designs, how they ended, sessions, digests;
                            study.sqlite.copy is a copy of it
        search_space.yaml   what is explored, fully resolved
        runs/<trial>-<repeat>.npz   one training run: its record and arrays (dse.store.runs)
        precision/<trial>-<repeat>/   what it measured at other precisions (dse.study.precision)
        trials.parquet, points.parquet, page.html
        plugins/            copies of its plugins' files    hardware/   its hardware profiles
        coordinators/       who works on it now (dse.study.claim)
        checkpoints/        where unfinished trainings stand (dse.study.checkpoints)
        bundles/<name>/     exported designs: the page shows their verdicts (dse.show.dashboard.verdicts)
        *.damaged           what `dse doctor --repair` has moved aside, laid out as it was

The book has the SHA-256 of every other file, so that a change of any byte, or a file of another study, is
an error when it is read. A file is written under a temporary name, flushed to the disk, and renamed: that of
a run is therefore either complete or absent, and its presence is what makes the run finished.
"""

from dse.store.arrays import DAMAGED_ARCHIVE as DAMAGED_ARCHIVE
from dse.store.arrays import RECORD as RECORD
from dse.store.arrays import fitted_of as fitted_of
from dse.store.arrays import load_arrays as load_arrays
from dse.store.arrays import record_arrays as record_arrays
from dse.store.arrays import record_of as record_of
from dse.store.arrays import response_arrays as response_arrays
from dse.store.arrays import response_of as response_of
from dse.store.arrays import save_arrays as save_arrays
from dse.store.arrays import work_arrays as work_arrays
from dse.store.arrays import work_of as work_of
from dse.store.book import BOOK as BOOK
from dse.store.book import COPY as COPY
from dse.store.book import Book as Book
from dse.store.book import digests as digests
from dse.store.book import document as document
from dse.store.book import keep as keep
from dse.store.errors import ENVIRONMENT as ENVIRONMENT
from dse.store.errors import REMEDY as REMEDY
from dse.store.errors import SPACE as SPACE
from dse.store.errors import WARNINGS as WARNINGS
from dse.store.errors import Damaged as Damaged
from dse.store.errors import InUse as InUse
from dse.store.errors import StoreError as StoreError
from dse.store.errors import damaged as damaged
from dse.store.errors import unreadable as unreadable
from dse.store.files import COORDINATORS as COORDINATORS
from dse.store.files import TEMPORARY as TEMPORARY
from dse.store.files import atomic as atomic
from dse.store.files import back_up as back_up
from dse.store.files import checksum as checksum
from dse.store.files import exclusive as exclusive
from dse.store.files import explained as explained
from dse.store.files import is_held as is_held
from dse.store.files import is_temporary as is_temporary
from dse.store.files import known_as as known_as
from dse.store.files import living as living
from dse.store.files import noted as noted
from dse.store.files import published as published
from dse.store.files import read_bytes as read_bytes
from dse.store.files import read_json as read_json
from dse.store.files import read_text as read_text
from dse.store.files import remove as remove
from dse.store.files import set_aside as set_aside
from dse.store.files import sweep as sweep
from dse.store.files import verify as verify
from dse.store.files import write_json as write_json
from dse.store.files import write_text as write_text
from dse.store.plain import heads_document as heads_document
from dse.store.plain import heads_of as heads_of
from dse.store.plain import plain as plain
from dse.store.plain import plain_cell as plain_cell
from dse.store.runs import RUNS as RUNS
from dse.store.runs import SCHEMA as SCHEMA
from dse.store.runs import first_run as first_run
from dse.store.runs import load_run as load_run
from dse.store.runs import named as named
from dse.store.runs import note_files as note_files
from dse.store.runs import read_record as read_record
from dse.store.runs import record_in as record_in
from dse.store.runs import run_file as run_file
from dse.store.runs import runs_in as runs_in
from dse.store.runs import runs_of as runs_of
from dse.store.runs import save_run as save_run
from dse.store.tables import made_from as made_from
from dse.store.tables import write_table as write_table
