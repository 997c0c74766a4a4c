"""Spikes as plain arrays, and send-on-delta by its definition, plain and slow."""

import numpy as np

from dse.base.records import Signals


def dense(spikes):
    """Return spikes as (sample, step, channel) bool, after a look at their order."""
    out = np.zeros((spikes.n_samples * spikes.n_steps, spikes.n_channels), dtype=bool)
    rows = np.repeat(np.arange(len(out)), np.diff(spikes.row_offsets))
    assert ((np.diff(rows) > 0) | (np.diff(spikes.channel) > 0)).all(), "sorted, and none twice"
    out[rows, spikes.channel] = True
    return out.reshape(spikes.n_samples, spikes.n_steps, spikes.n_channels)


def recorded(*recordings, step_ms=10.0):
    values = np.concatenate([np.asarray(x, np.float32).reshape(len(x), -1) for x in recordings])
    values.setflags(write=False)
    return Signals(values, np.cumsum([0, *map(len, recordings)]), step_ms, {})


def fitted(encoder, signals, n_steps):
    n = signals.n_recordings
    return encoder.fitted(signals, np.zeros(n, int), n_steps, np.zeros(n, int), 1, np.arange(n))


def encoded(encoder, signals):
    return dense(encoder.encode_all(signals, np.zeros(signals.n_recordings, int), np.diff(signals.offsets)))


def send_on_delta(values, thresholds, reference, polarity="separate", first=None):
    """Return the spikes of one recording, (step, spike channel) bool; `first` is the level at its start."""
    n_steps, n = values.shape
    spikes = np.zeros((n_steps, len(thresholds), 2, n), dtype=bool)
    x = values.astype(np.float64)
    for k, theta in enumerate(thresholds):
        r = (x[0] if first is None else np.asarray(first, float)).copy()
        for t in range(n_steps):
            d = x[t] - r
            fires = np.abs(d) >= theta
            spikes[t, k, 0], spikes[t, k, 1] = fires & (d < 0), fires & (d > 0)
            moves = {"value": d, "step": np.sign(d) * theta}
            moved = moves.get(reference, np.sign(d) * theta * np.floor(np.abs(d) / theta))
            r = np.where(fires, r + moved, r)
    return (spikes.any(axis=2) if polarity == "merged" else spikes).reshape(n_steps, -1)
