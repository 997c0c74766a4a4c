"""A data set in memory, put on disk as a prepared one."""

import numpy as np

from dse.data.dataset import cache
from dse.data.dataset.files import Meta, write_dataset, write_spikes
from dse.data.dataset.parts import Part, Rows
from dse.store import heads_document


def in_a_row(n_channels):
    """Return positions of taxels that lie in a row."""
    x = np.arange(n_channels, dtype=np.int32)
    return np.stack([x, np.zeros_like(x), np.zeros_like(x)], axis=1)


def part_of(data):
    """Return what a source would have been that these spikes come from."""
    spikes = data.spikes

    def rows(threads):
        for i in range(spikes.n_samples):
            borders = spikes.row_offsets[i * spikes.n_steps : (i + 1) * spikes.n_steps + 1]
            yield Rows(np.diff(borders), spikes.channel[borders[0] : borders[-1]])

    lengths = np.full(spikes.n_samples, spikes.n_steps)
    return Part(
        data.start, data.start_low, data.start_high, data.n_steps, spikes.n_steps, data.positions,
        spikes.step_ms, lengths, None, rows,
    )  # fmt: skip


def save(data, folder):
    """Write a data set to a folder, and its spikes to one beside it."""
    beside = folder.with_name(f"{folder.name} spikes")
    split = data.train, data.validation, data.test

    def fill(place):
        meta = Meta(spikes=beside.name, classes=list(data.classes), fitted={}, warnings=["too easy"],
                    heads=heads_document(data.heads), transductive="")  # fmt: skip
        write_dataset(place, data.target, split, meta)

    cache.made(beside.parent, beside.name, lambda place: write_spikes([part_of(data)], place))
    cache.made(folder.parent, folder.name, fill)
