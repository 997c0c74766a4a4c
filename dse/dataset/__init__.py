"""The data set of a resolved design: recordings, windows, split and spikes, made once and kept in a cache.

It joins the packages that turn data into spikes; models see a `Dataset` and nothing of where it came from.
Spikes are kept apart from targets: tasks that differ in labels alone share them (`dse.dataset.cache`).
"""

from dse.dataset.assemble import as_prepared as as_prepared
from dse.dataset.assemble import build as build
from dse.dataset.assemble import build_for as build_for
from dse.dataset.assemble import find as find
from dse.dataset.assemble import left_out as left_out
from dse.dataset.assemble import lengths as lengths
from dse.dataset.assemble import load_or_prepare as load_or_prepare
from dse.dataset.assemble import prepare as prepare
from dse.dataset.assemble import recordings as recordings
from dse.dataset.assemble import split_of as split_of
from dse.dataset.files import load as load
from dse.dataset.files import read_meta as read_meta
from dse.dataset.keys import dataset_key as dataset_key
from dse.dataset.keys import same_spikes as same_spikes
from dse.dataset.shifts import has_room as has_room
from dse.dataset.shifts import shifted as shifted
from dse.dataset.stages import stages as stages
