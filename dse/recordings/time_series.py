"""Sampled recordings in an .npz file: laid end to end with offsets, or of one length in a cube."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Self

import numpy as np

from dse.recordings import RecordingError, npz
from dse.recordings.files import content, locate
from dse.recordings.labels import class_names_key, columns_key, label_columns
from dse.recordings.positions import check_positions, position_faults, positions_key, taxel_positions
from dse.records import Array, Ints, Signals
from dse.registry import param, register


@register("recordings", "time_series")
@dataclasses.dataclass(frozen=True)
class TimeSeries:
    """Sampled recordings of an .npz file.

    `signal` is (sum of lengths, channel) with `offsets`, recording i being signal[offsets[i]:offsets[i+1]],
    or (recording, sample, channel) without.
    """

    file: str = param(
        doc="the .npz file: an absolute path, or relative to the YAML file or to $DSE_DATA", axis=False
    )
    step_ms: float = param(doc="sampling period", unit="ms", low=0, low_open=True, axis=False)
    signal: str = param("signal", doc="name of the array of samples", axis=False)
    offsets: str | None = param(
        None,
        doc="name of the array of the n + 1 borders between recordings (default: a cube, recordings of one "
        "length)",
        axis=False,
    )
    columns: Mapping[str, str] = columns_key()
    class_names: Mapping[str, str] = class_names_key()
    positions: tuple[tuple[int, int], ...] | None = positions_key()

    def __post_init__(self) -> None:
        check_positions(self.positions)

    def _names(self) -> list[str]:
        offsets = [] if self.offsets is None else [self.offsets]
        return [self.signal, *offsets, *self.columns.values(), *self.class_names.values()]

    def _count(self, shapes: npz.Shapes) -> int | None:
        if self.offsets is None:
            return shapes[self.signal][0] if self.signal in shapes else None
        return shapes[self.offsets][0] - 1 if self.offsets in shapes else None

    def _n_channels(self, shapes: npz.Shapes) -> int | None:
        shape = shapes.get(self.signal, ())
        return shape[-1] if len(shape) == (3 if self.offsets is None else 2) else None

    def check(self, base: Path) -> list[str]:
        """Return the faults that the file's headers show."""
        faults = npz.faults(self.file, base, self._names(), self.columns, self.class_names, self._count)
        if self.positions is None or faults:
            return faults
        return position_faults(self.positions, self._n_channels(npz.headers(locate(self.file, base))))

    def with_columns_found(self, base: Path) -> Self:
        """Return the component with only the label columns that its file holds."""
        columns, class_names = npz.columns_found(self.file, base, self.columns, self.class_names)
        return dataclasses.replace(self, columns=columns, class_names=class_names)

    def content(self, base: Path) -> str:
        """Return the hash of the file."""
        return content(locate(self.file, base))

    def read(self, base: Path) -> Signals:
        """Return the recordings.

        Raises:
            RecordingError: anything wrong with the file, naming array, recording and sample.
        """
        path = locate(self.file, base)
        arrays = npz.load(path, self._names())
        offsets = None if self.offsets is None else arrays[self.offsets]
        flat, borders = end_to_end(arrays[self.signal], offsets, f"{path.name}: '{self.signal}'")
        columns = label_columns(arrays, self.columns, self.class_names, len(borders) - 1, path.name)
        return Signals(flat, borders, float(self.step_ms), columns)

    def channel_positions(self, base: Path) -> Ints:
        """Return x, y and plane 0 of every channel, which is a taxel.

        Raises:
            RecordingError: the file cannot be read, or positions are given for another number of taxels.
        """
        path = locate(self.file, base)
        n = self._n_channels(npz.headers(path))
        if not n:
            raise RecordingError(f"{path.name}: '{self.signal}' has no channel")
        return taxel_positions(self.positions, np.arange(n), np.zeros(n, dtype=np.int64))


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
