"""Spikes that an encoder makes of spikes: recordings of events or rasters, taken for signals of their counts.

An encoder wants a sample of every channel at every step, so what it is shown is dense by nature: recordings
are shown to it a few at a time, but those that it learns from all at once.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np

from dse.base.records import Bools, Ints, Signals, Spikes
from dse.config.contracts import Encoder
from dse.data.dataset.files import Stored
from dse.data.dataset.parts import NO_ROWS, Part, Rows, refusals, rows_of
from dse.data.recordings.splits import Labelled

# Of signals that are shown to an encoder at a time; one recording may be more.
_DENSE_BYTES = 2**24


def learnt(encoder: Encoder, signals: Signals, first: Ints, n_steps: int, of: Labelled) -> Encoder:
    """Return an encoder fitted to training recordings; unchanged if it learns nothing.

    Labels of other recordings are shown to an encoder that says it is transductive, and to no other.
    first: (n,) first step of the evaluated windows.

    Raises:
        RecordingError: the encoder cannot learn from them.
    """
    if not encoder.learns:
        return encoder
    shown = of.codes
    if not encoder.transductive:
        shown = np.full_like(of.codes, -1)
        shown[of.train] = of.codes[of.train]
    with refusals():
        return encoder.fitted(signals, first, n_steps, shown, len(of.classes), of.train)


def learnt_from_spikes(encoder: Encoder, stored: Stored, used: Bools, of: Labelled) -> Encoder:
    """Return what `learnt` returns, for recordings that are spikes, perhaps with a test file behind them.

    used: (n,) bool, recordings that have a window.
    """
    chosen = np.flatnonzero(used) if encoder.transductive else of.train
    lengths = _lengths(stored, np.isin(np.arange(len(stored.start)), chosen))
    signals = as_signals(stored.spikes, chosen, lengths[chosen])
    some = dataclasses.replace(of, codes=of.codes[chosen], train=np.flatnonzero(np.isin(chosen, of.train)))
    return learnt(encoder, signals, stored.start[chosen], stored.n_steps, some)


def encoded(stored: Stored, encoder: Encoder, used: Bools) -> Part:
    """Return spikes that an encoder makes of stored spikes; windows mean the same steps as before.

    A recording is encoded from its first stored step on, until the end of its last window; those that are not
    used, (n,) bool, get no spikes.
    """
    lengths = _lengths(stored, used)
    # What reads the labels of certain recordings must find them all, in their order.
    most = max(1, _DENSE_BYTES // (4 * stored.spikes.n_channels * max(1, int(lengths.max(initial=0)))))
    at_once = len(lengths) if encoder.transductive else most

    def rows(threads: int) -> Iterator[Rows]:
        for some in np.split(np.arange(len(lengths)), range(at_once, len(lengths), at_once)):
            chosen = some[lengths[some] > 0]
            encoded_rows: Iterator[Rows] = iter(())
            if chosen.size:
                signals = as_signals(stored.spikes, chosen, lengths[chosen])
                with refusals():
                    spikes = encoder.encode_all(signals, np.zeros_like(chosen), lengths[chosen])
                encoded_rows = rows_of(spikes)
            for i in some:
                yield next(encoded_rows) if lengths[i] else NO_ROWS

    with refusals():
        positions = encoder.positions(stored.positions)
    return Part(
        stored.start, stored.low, stored.high, stored.n_steps, int(lengths.max()),
        positions, stored.spikes.step_ms, stored.lengths, stored.levels, rows,
        lambda: stored.notes, rises=encoder.rises(stored.spikes.n_channels),
    )  # fmt: skip


def as_signals(spikes: Spikes, chosen: Ints, lengths: Ints) -> Signals:
    """Return recordings of spikes as signals of the number of spikes per step, without columns.

    That is 0 or 1, but for events (`Spikes.t_us`). lengths: (m,) steps of each of the chosen, from its first.
    """
    offsets = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
    values = np.zeros((int(offsets[-1]), spikes.n_channels), dtype=np.float32)
    for i, begin, length in zip(chosen, offsets, lengths, strict=False):
        borders = spikes.row_offsets[i * spikes.n_steps : i * spikes.n_steps + length + 1]
        steps = np.repeat(np.arange(begin, begin + length), np.diff(borders))
        np.add.at(values, (steps, spikes.channel[borders[0] : borders[-1]]), 1)
    return Signals(values, offsets, spikes.step_ms, {})


def _lengths(stored: Stored, used: Bools) -> Ints:
    """Return (n,) steps from the first that is stored to the end of the last window; 0 where not used."""
    return np.where(used, stored.high.astype(np.int64) + stored.n_steps, 0)
