"""Recordings laid end to end: their samples and the borders between them, checked."""

from __future__ import annotations

import numpy as np

from dse.recordings import RecordingError
from dse.records import Array, Ints


def end_to_end(values: Array, offsets: Array | None, where: str) -> tuple[Array, Ints]:
    """Return samples (sum of lengths, channel) float32 and borders (n + 1,) int64, both checked.

    Raises:
        RecordingError: wrong number of axes, bad borders, an empty recording, NaN or infinite samples.
    """
    if values.dtype.kind not in "biuf":
        raise RecordingError(f"{where} must hold numbers, got {values.dtype}")
    if offsets is None:
        if values.ndim != 3:
            raise RecordingError(
                f"{where} must be (recording, sample, channel) without offsets, got shape {values.shape}"
            )
        n, n_steps, n_channels = values.shape
        offsets, values = np.arange(n + 1) * n_steps, values.reshape(n * n_steps, n_channels)
    elif values.ndim != 2:
        raise RecordingError(f"{where} must be (sample, channel), got shape {values.shape}")
    borders = checked_offsets(offsets, len(values), where)
    if values.shape[1] == 0:
        raise RecordingError(f"{where} has no channel")
    with np.errstate(over="ignore"):  # what is too large for float32 is reported as infinite
        flat = np.ascontiguousarray(values, dtype=np.float32)
    bad = ~np.isfinite(flat)
    if bad.any():
        sample, channel = (int(x) for x in np.argwhere(bad)[0])
        recording = int(np.searchsorted(borders, sample, side="right")) - 1
        raise RecordingError(
            f"{where} must be finite, got {flat[sample, channel]} in recording {recording}, "
            f"sample {sample - borders[recording]}, channel {channel}"
        )
    return flat, borders


def checked_offsets(offsets: Array, n_rows: int, where: str, *, may_be_empty: bool = False) -> Ints:
    """Return borders as int64, checked from 0 to n_rows; no recording is empty unless it may be.

    Raises:
        RecordingError: they do not.
    """
    if offsets.ndim != 1 or len(offsets) < 2 or offsets.dtype.kind not in "iu":
        raise RecordingError(
            f"{where}: offsets must be integers, one more than there are recordings, "
            f"got {offsets.dtype} of shape {offsets.shape}"
        )
    borders = offsets.astype(np.int64)
    lengths = np.diff(borders)
    if (lengths < 0).any():
        i = int((lengths < 0).argmax())
        raise RecordingError(
            f"{where}: offsets must not decrease, got {borders[i]} and then {borders[i + 1]}"
        )
    if borders[0] != 0 or borders[-1] != n_rows:
        raise RecordingError(
            f"{where}: offsets must run from 0 to its end at {n_rows}, got {borders[0]} to {borders[-1]}"
        )
    if not may_be_empty and (lengths == 0).any():
        raise RecordingError(f"{where}: recording {int((lengths == 0).argmax())} is empty")
    return borders
