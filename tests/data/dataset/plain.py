"""The functions of `dse.data.dataset`, given designs as plain sections, which tests change in a line."""

import numpy as np

from dse.data import dataset
from dse.data.dataset import keys, parts
from tests.spaces import sections


def build(design, base, threads=1):
    return dataset.build(sections(design), base, threads)


def build_for(design, base, classes):
    return dataset.build_for(sections(design), base, classes)[:2]


def prepare(design, base, root, threads=1):
    return dataset.prepare(sections(design), base, root, threads)


def load_or_prepare(design, base, folder):
    return dataset.load_or_prepare(sections(design), base, folder)


def as_prepared(design, folder):
    return dataset.as_prepared(sections(design), folder)


def dataset_key(design, base):
    return dataset.dataset_key(sections(design), base)


def spikes_key(design, base, used):
    return keys.spikes_key(sections(design), base, used)


def same_spikes(design):
    return dataset.same_spikes(sections(design))


def placed(recordings, design, *args, **others):
    return parts.placed(recordings, sections(design), *args, **others)


def dense(data, i, first=0, n=None):
    """Return the spikes of n stored steps of a sample, (step, channel) counts; None: of all."""
    spikes = data.spikes
    n = spikes.n_steps if n is None else n
    out = np.zeros((n, spikes.n_channels), dtype=int)
    for t in range(n):
        row = i * spikes.n_steps + first + t
        np.add.at(out[t], spikes.channel[spikes.row_offsets[row] : spikes.row_offsets[row + 1]], 1)
    return out


def entries(root):
    """Return the names of the entries of a cache by what they are."""
    found = {"spikes": [], "dataset": []}
    for path in root.glob("*/meta.json"):
        found["dataset" if (path.parent / "target.npy").exists() else "spikes"].append(path.parent.name)
    return found
