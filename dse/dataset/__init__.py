"""The data set of a resolved design: recordings, windows, split and spikes, built once and kept on disk.

It joins the packages that turn data into spikes; models see a `Dataset` and nothing of where it came from.
"""

from dse.dataset.assemble import build, build_for
from dse.dataset.cache import dataset_key, load, save

__all__ = ["build", "build_for", "dataset_key", "load", "save"]
