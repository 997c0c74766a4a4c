"""The contract of an encoder."""

from __future__ import annotations

import dataclasses

import numpy as np

from dse.base.records import Array, Signals, Spikes
from dse.config.contracts import Encoder
from dse.testing import small
from dse.testing.expect import expect, expect_component, pure, same


def check_encoder(encoder: Encoder, signals: Signals | None = None, *, causal: bool = True) -> None:
    """Check an encoder: causal, deterministic, each recording by itself, channels and places as it says.

    An encoder that reads labels (`transductive`) need not encode recordings one by one.

    Args:
        encoder: not fitted.
        signals: four recordings or more of 16 steps or more each; absent: small ones.
        causal: False for an encoder which states that a spike may depend on the whole window.

    Raises:
        AssertionError: what it violates.
    """
    name = expect_component(encoder)
    signals = small.signals() if signals is None else signals
    n = signals.n_recordings
    first, length = np.arange(n) % 3, np.full(n, 12)
    length[-1] = 9  # shorter than the others
    if encoder.learns:
        encoder = _fitted(name, encoder, signals)
    places = small.places(signals.n_channels)
    spikes = pure(f"{name}.encode_all", encoder.encode_all, signals, first, length)
    n_channels = encoder.n_channels(signals.n_channels)
    expect(
        spikes.n_channels == n_channels,
        f"{name}.n_channels must be that of its spikes, {spikes.n_channels}, got {n_channels}",
    )
    _check_spikes(name, spikes, n, length)
    positions = np.asarray(encoder.positions(places))
    expect(
        positions.shape == (n_channels, 3) and positions.dtype.kind == "i",
        f"{name}.positions must be ({n_channels}, 3) integers, got {positions.shape} of {positions.dtype}",
    )
    expect(
        len(np.unique(positions, axis=0)) == n_channels, f"{name}.positions must tell all its channels apart"
    )
    rises = encoder.rises(signals.n_channels)
    expect(
        rises is None or (rises.shape == (n_channels,) and rises.dtype.kind == "i" and bool(rises.all())),
        f"{name}.rises must be ({n_channels},) whole numbers that are not 0, or None, got {rises}",
    )
    if encoder.transductive:
        return
    together = small.dense(spikes)
    if causal:
        _check_causal(name, encoder, signals, first, length)
    for i in range(n):
        _check_alone(
            name, encoder, signals, i, slice(first[i], first[i] + length[i]), together[i, : length[i]]
        )


def _fitted(name: str, encoder: Encoder, signals: Signals) -> Encoder:
    n = signals.n_recordings
    target = np.arange(n) % 2
    train = np.arange(n) if encoder.transductive else np.arange(n - 2)
    shown = target if encoder.transductive else np.where(np.isin(np.arange(n), train), target, -1)
    fitted = pure(f"{name}.fitted", encoder.fitted, signals, np.zeros(n, int), 16, shown, 2, train)
    expect(type(fitted) is type(encoder), f"{name}.fitted must return an encoder of its own class")
    return fitted


def _check_spikes(name: str, spikes: Spikes, n: int, length: Array) -> None:
    expect(
        spikes.n_samples == n and spikes.n_steps >= int(length.max()),
        f"{name} must return {n} samples of {length.max()} steps or more, got {spikes.n_samples} of "
        f"{spikes.n_steps}",
    )
    offsets, channel = spikes.row_offsets, spikes.channel
    rising = (np.diff(offsets) >= 0).all() and offsets[0] == 0 and offsets[-1] == len(channel)
    expect(rising, f"{name}: row_offsets must rise from 0 to the number of spikes")
    inside = ((channel >= 0) & (channel < spikes.n_channels)).all()
    expect(inside, f"{name}: channels must lie in 0..{spikes.n_channels - 1}")
    row = np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))
    in_order = (np.diff(row.astype(np.int64) * spikes.n_channels + channel) > 0).all()
    expect(in_order, f"{name}: spikes must be sorted by step and channel, without duplicates")
    late = row % spikes.n_steps >= length[row // spikes.n_steps]
    expect(not late.any(), f"{name} must leave the rows after a recording's length empty")
    expect(len(channel), f"{name} must spike for signals that move")


def _check_causal(name: str, encoder: Encoder, signals: Signals, first: Array, length: Array) -> None:
    """Change every recording after step 8 of its window: the spikes until then must stay."""
    until = 8
    values = signals.values.copy()
    for i in range(signals.n_recordings):
        begin, end = signals.offsets[i] + first[i] + until, signals.offsets[i + 1]
        values[begin:end] = values[begin:end][::-1] * 2
    changed = dataclasses.replace(signals, values=values)
    before, after = (small.dense(encoder.encode_all(x, first, length))[:, :until] for x in (signals, changed))
    expect(same(before, after), f"{name} must be causal: a spike may not depend on later values")


def _check_alone(
    name: str, encoder: Encoder, signals: Signals, i: int, window: slice, among_others: Array
) -> None:
    """Encode a recording by itself, whole and sample by sample; an encoder may refuse the latter.

    i: the recording. window: the steps that are encoded. among_others: (step, channel) its spikes where all
    recordings are encoded.
    """
    values = signals.values[signals.offsets[i] : signals.offsets[i + 1]]
    one = Signals(values=values, offsets=np.array([0, len(values)]), step_ms=signals.step_ms, columns={})
    length = np.array([len(among_others)])
    alone = small.dense(encoder.encode_all(one, np.array([window.start]), length))[0, : len(among_others)]
    expect(same(alone, among_others), f"{name} must encode a recording alone as it does among others")
    try:
        running = encoder.running(signals.n_channels, signals.step_ms)
    except ValueError:
        return
    rows = np.zeros((window.stop, among_others.shape[1]), bool)
    for row, sample in zip(rows, values[: window.stop], strict=True):
        row[running.step(sample)] = True
    text = f"{name}.running must spike sample by sample as encode_all does"
    expect(same(rows[window.start :], among_others), text)
