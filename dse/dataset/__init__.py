"""The data set of a resolved design: recordings, windows, split and spikes, made once and kept in a cache.

It joins the packages that turn data into spikes; models see a `Dataset` and nothing of where it came from.
Spikes are kept apart from targets: tasks that differ in labels alone share them (`dse.dataset.cache`).
"""

from dse.dataset.assemble import (
    as_prepared,
    build,
    build_for,
    find,
    lengths,
    left_out,
    load_or_prepare,
    prepare,
    recordings,
    transductive,
    warnings,
)
from dse.dataset.files import load
from dse.dataset.keys import dataset_key, same_spikes
from dse.dataset.moved import moved, with_crops, with_room
from dse.dataset.stages import stages

__all__ = [
    "as_prepared",
    "build",
    "build_for",
    "dataset_key",
    "find",
    "lengths",
    "left_out",
    "load",
    "load_or_prepare",
    "moved",
    "prepare",
    "recordings",
    "same_spikes",
    "stages",
    "transductive",
    "warnings",
    "with_crops",
    "with_room",
]
