"""The data set of a resolved design: recordings, windows, split and spikes, made once and kept in a cache.

It joins the packages that turn data into spikes; models see a `Dataset` and nothing of where it came from.
Spikes are kept apart from targets: tasks that differ in labels alone share them (`dse.data.dataset.cache`).
"""

from dse.data.dataset.assemble import as_prepared as as_prepared
from dse.data.dataset.assemble import build as build
from dse.data.dataset.assemble import build_for as build_for
from dse.data.dataset.assemble import find as find
from dse.data.dataset.assemble import left_out as left_out
from dse.data.dataset.assemble import lengths as lengths
from dse.data.dataset.assemble import load_or_prepare as load_or_prepare
from dse.data.dataset.assemble import prepare as prepare
from dse.data.dataset.assemble import recordings as recordings
from dse.data.dataset.assemble import split_of as split_of
from dse.data.dataset.files import load as load
from dse.data.dataset.files import read_meta as read_meta
from dse.data.dataset.keys import dataset_key as dataset_key
from dse.data.dataset.keys import same_spikes as same_spikes
from dse.data.dataset.shifts import has_room as has_room
from dse.data.dataset.shifts import shifted as shifted
from dse.data.dataset.stages import stages as stages
