"""The data set of a resolved design: recordings, windows, split and spikes, made once and kept in a cache.

It joins the packages that turn data into spikes; models see a `Dataset` and nothing of where it came from.
Spikes are kept apart from targets: tasks that differ in labels alone share them (`dse.dataset.cache`).
"""

from dse.dataset.assemble import (
    as_prepared,
    build,
    build_for,
    find,
    left_out,
    lengths,
    load_or_prepare,
    prepare,
    recordings,
    split_of,
    transductive,
    warnings,
)
from dse.dataset.files import load
from dse.dataset.keys import dataset_key, same_spikes
from dse.dataset.shifts import has_room, shifted
from dse.dataset.stages import stages

__all__ = [
    "as_prepared",
    "build",
    "build_for",
    "dataset_key",
    "find",
    "has_room",
    "left_out",
    "lengths",
    "load",
    "load_or_prepare",
    "prepare",
    "recordings",
    "same_spikes",
    "shifted",
    "split_of",
    "stages",
    "transductive",
    "warnings",
]
