"""Recordings of one file -> their spikes and where the windows lie in them; several parts -> one Dataset."""

from __future__ import annotations

import dataclasses

import numpy as np

from dse import preprocessing
from dse.dataset.sections import Resolved, component, section
from dse.preprocessing import Preprocessing
from dse.recordings import RecordingError, Recordings
from dse.recordings.windows import Window, mean_levels, place, signal_onset, without_mean
from dse.records import Array, Dataset, Events, Rasters, Signals, Spikes


@dataclasses.dataclass(frozen=True)
class Part:
    """Spikes of one file and where its windows lie in them."""

    spikes: Spikes
    start: Array
    low: Array
    high: Array
    n_steps: int


def part_of(
    recordings: Recordings, resolved: Resolved, used: Array
) -> tuple[Part, tuple[Array, Array | None]]:
    """Return the spikes and windows of one file, and (lengths, resting levels) for the leakage test.

    Args:
        recordings: as read.
        resolved: the design.
        used: (n,) bool, recordings that are in some part of the split; the others get no spikes.

    Raises:
        RecordingError: a window does not fit, or a section is absent or out of place.
    """
    window = section(Window, resolved.get("window"))
    at_onset = window.at == "contact_onset"
    levels: Array | None = None
    _check_sections(recordings, resolved)
    if window.remove_mean and not isinstance(recordings, Signals):
        raise RecordingError("window.remove_mean must be false for recordings of events or spikes, got true")
    if isinstance(recordings, Rasters):
        spikes = recordings.spikes
        lengths = np.full(spikes.n_samples, spikes.n_steps)
        onset = _raster_onset(spikes, window) if at_onset else None
        start, low, high, n_steps = place(window, lengths, used, onset)
        return Part(spikes, start, low, high, n_steps), (lengths, None)
    if isinstance(recordings, Signals):
        lengths = np.diff(recordings.offsets)
        onset = signal_onset(recordings, window.onset_threshold) if at_onset else None
        start, low, high, n_steps = place(window, lengths, used, onset)
        levels = mean_levels(recordings, start, n_steps)
        kept = np.where(used, high - low + n_steps, 0)
        encoder = component("encoders", resolved["encoder"])
        signals = without_mean(recordings, levels) if window.remove_mean else recordings
        spikes = encoder.encode_all(signals, low, kept)
    else:
        settings = section(Preprocessing, resolved["preprocessing"])
        lengths = preprocessing.n_bins(recordings, settings)
        onset = preprocessing.event_onset(recordings, settings, window.onset_threshold) if at_onset else None
        start, low, high, n_steps = place(window, lengths, used, onset)
        kept = np.where(used, high - low + n_steps, 0)
        spikes = preprocessing.spikes_of(recordings, settings, low, kept)
    return Part(spikes, start - low, np.zeros_like(low), high - low, n_steps), (lengths, levels)


def _check_sections(recordings: Recordings, resolved: Resolved) -> None:
    kind = resolved["data"]["kind"]
    needed = {Signals: "encoder", Events: "preprocessing"}.get(type(recordings))
    for name in ("encoder", "preprocessing"):
        if name == needed and not resolved.get(name):
            raise RecordingError(f"{name} must be given: data of kind '{kind}' becomes spikes by it")
        if name != needed and resolved.get(name):
            raise RecordingError(f"{name} must be absent: data of kind '{kind}' has no use for it")


def _raster_onset(spikes: Spikes, window: Window) -> Array:
    counts = np.diff(spikes.row_offsets).reshape(spikes.n_samples, spikes.n_steps)
    enough = counts >= window.onset_threshold
    return np.where(enough.any(axis=1), enough.argmax(axis=1), -1)


def joined(
    parts: list[Part], codes: Array, classes: tuple[str, ...], split: tuple[Array, Array, Array]
) -> Dataset:
    """Return the data set of one part or of several laid end to end.

    Args:
        parts: the data file, and the test file if there is one.
        codes: targets of all recordings.
        classes: names of the classes.
        split: train, validation and test indices.

    Raises:
        RecordingError: the parts differ in channels, step or window.
    """
    first, n_steps = parts[0], max(x.spikes.n_steps for x in parts)
    for other in parts[1:]:
        for name, a, b in (
            ("channels", first.spikes.n_channels, other.spikes.n_channels),
            ("ms per step", first.spikes.step_ms, other.spikes.step_ms),
            ("steps per window", first.n_steps, other.n_steps),
        ):
            if a != b:
                raise RecordingError(f"the test file must have {a} {name} as the data file has, got {b}")
    rows = [
        np.pad(
            np.diff(x.spikes.row_offsets).reshape(-1, x.spikes.n_steps),
            ((0, 0), (0, n_steps - x.spikes.n_steps)),
        )
        for x in parts
    ]
    offsets = np.concatenate([[0], np.cumsum(np.concatenate(rows))]).astype(np.int64)
    channel = np.concatenate([x.spikes.channel for x in parts])
    start, low, high = (
        np.concatenate([getattr(x, name) for x in parts]).astype(np.int32)
        for name in ("start", "low", "high")
    )
    train, validation, test = (x.astype(np.int64) for x in split)
    return Dataset(
        spikes=Spikes(offsets, channel, n_steps, first.spikes.n_channels, first.spikes.step_ms),
        target=codes, classes=classes, start=start, start_low=low, start_high=high, n_steps=first.n_steps,
        train=train, validation=validation, test=test,
    )  # fmt: skip
