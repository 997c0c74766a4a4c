"""One event recording at every stage of the preprocessing of a design, for a look at what it does."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from dse.base.records import Array, Block, Rasters, Signals
from dse.config.resolved import Sections
from dse.data import preprocessing
from dse.data.dataset.parts import placed, pooling_of
from dse.data.preprocessing.stages import Stages
from dse.data.recordings import RecordingError, trials_of


def stages(design: Sections, base: Path, sample: int) -> Stages:
    """Return one recording of a design's data at every stage; it is read, or simulated, again.

    The crop of the design is fitted, and its window has a length. Recordings of the test file follow those of
    the data.

    Raises:
        RecordingError: the recordings are not events, or there is no such recording.
    """
    recordings = design.data.read(base)
    n = recordings.n_recordings
    if sample >= n and design.test is not None:
        sample, recordings = sample - n, design.test.read(base)
        n = recordings.n_recordings
    if isinstance(recordings, Signals | Rasters) or design.preprocessing is None:
        raise RecordingError(f"data must be events to be preprocessed, got kind '{design.kinds['data']}'")
    if not 0 <= sample < n:
        raise RecordingError(f"recording must be below {n}, got {sample}")
    pools = pooling_of(recordings, design.preprocessing)
    part = placed(recordings, design, np.arange(n) == sample)
    events = _joined(recordings.blocks(sample))
    begun_us = 0 if trials_of(recordings) else int(events.t_us[0])
    whole = pools._replace(start_us=0, end_us=preprocessing.END_OF_TIME_US, rate_floor_hz=0.0)
    events = dataclasses.replace(events, t_us=events.t_us - begun_us)
    n_bins = whole.n_bins(int(events.t_us[-1]) + 1 if len(events.t_us) else 0)
    counts, channels = preprocessing.pool([events], whole, 0, 0, n_bins)
    assert part.first is not None  # placed has it
    begin_us = pools.start_us + int(part.first[sample] + part.start[sample]) * pools.bin_us
    return Stages(
        name=_name(recordings.columns, sample),
        events=events,
        frame=(recordings.width, recordings.height),
        crop=pools.crop,
        counts=counts,
        channels=channels,
        n_channels=pools.n_channels,
        bin_us=pools.bin_us,
        begin_us=begin_us,
        end_us=begin_us + part.n_steps * pools.bin_us,
    )


def _joined(blocks: Iterable[Block]) -> Block:
    arrays = [(block.t_us, block.x, block.y, block.polarity) for block in blocks]
    return Block(*(np.concatenate(column) for column in zip(*arrays, strict=True)))


def _name(columns: Mapping[str, Array], sample: int) -> str:
    """Return the labels of a recording that are words, else its number."""
    words = [str(values[sample]) for values in columns.values() if values.dtype.kind in "US"]
    return ", ".join(words) or f"recording {sample}"
