"""Sampled recordings in arrays: laid end to end with offsets, or of one length in a cube."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Self

import numpy as np

from dse.recordings import RecordingError, npz
from dse.recordings.beside import labels_key, load, names_in, shapes_in
from dse.recordings.borders import end_to_end
from dse.recordings.files import content, locate
from dse.recordings.labels import class_names_key, columns_key, label_columns, shape_faults
from dse.recordings.positions import check_positions, position_faults, positions_key, taxel_positions
from dse.records import Array, Ints, Signals
from dse.registry import param, register

_AXES = (["channel", "recording", "step"], ["recording", "step"])


@register("recordings", "time_series")
@dataclasses.dataclass(frozen=True)
class TimeSeries:
    """Sampled recordings of an .npz, .npy, .mat or .h5 file.

    `signal` is (sum of lengths, channel) with `offsets`, recording i being signal[offsets[i]:offsets[i+1]],
    or (recording, sample, channel) without. The array of an .npy file is named `array`; a cell of matrices in
    an .mat file holds recordings of different lengths.
    """

    file: str = param(
        doc="the .npz, .npy, .mat or .h5 file: an absolute path, or relative to the YAML file or to "
        "$DSE_DATA",
        axis=False,
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
    axes: str | None = param(
        None,
        doc="order of the axes of a cube, e.g. 'step channel recording'; 'recording step': one channel "
        "(default: recording step channel)",
        axis=False,
    )
    labels: str | None = labels_key()

    def __post_init__(self) -> None:
        check_positions(self.positions)
        if self.axes is not None and (self.offsets is not None or sorted(self.axes.split()) not in _AXES):
            if self.offsets is not None:
                raise RecordingError("data.axes must be absent where data.offsets is given")
            raise RecordingError(
                f"data.axes must name recording, step and perhaps channel, each once, got '{self.axes}'"
            )

    def _names(self) -> list[str]:
        offsets = [] if self.offsets is None else [self.offsets]
        return [self.signal, *offsets, *(self._label_names() if self.labels is None else [])]

    def _label_names(self) -> list[str]:
        return [*self.columns.values(), *self.class_names.values()]

    def _shape(self, shapes: npz.Shapes) -> tuple[int, int] | None:
        """Return number of recordings and of channels of a cube; None where its axes are others."""
        shape, axes = shapes.get(self.signal, ()), (self.axes or "recording step channel").split()
        if len(shape) != len(axes):
            return None
        return shape[axes.index("recording")], shape[axes.index("channel")] if "channel" in axes else 1

    def _count(self, shapes: npz.Shapes) -> int | None:
        if self.offsets is None:
            cube = self._shape(shapes)
            return cube[0] if cube else shapes[self.signal][0] if shapes.get(self.signal) else None
        return shapes[self.offsets][0] - 1 if shapes.get(self.offsets) else None

    def _n_channels(self, shapes: npz.Shapes) -> int | None:
        if self.offsets is None:
            cube = self._shape(shapes)
            return cube[1] if cube else None
        shape = shapes.get(self.signal, ())
        return shape[-1] if len(shape) == 2 else None

    def check(self, base: Path) -> list[str]:
        """Return the faults that the headers of the file, and of that of the labels, show."""
        columns, class_names = (self.columns, self.class_names) if self.labels is None else ({}, {})
        faults = npz.faults(self.file, base, self._names(), columns, class_names, self._count)
        if self.labels is not None:
            faults += self._label_faults(base, self.labels)
        if self.positions is None or faults:
            return faults
        return position_faults(self.positions, self._n_channels(npz.headers(locate(self.file, base))))

    def _label_faults(self, base: Path, labels: str) -> list[str]:
        try:
            path, shapes = locate(labels, base), shapes_in(locate(labels, base))
            count = self._count(npz.headers(locate(self.file, base)))
        except RecordingError as error:
            return [str(error)]
        absent = [npz.missing(path, name, shapes) for name in self._label_names() if name not in shapes]
        if count is None or absent:
            return absent
        return shape_faults(shapes, self.columns, self.class_names, count, path.name)

    def with_columns_found(self, base: Path) -> Self:
        """Return the component with only the label columns that its file, or that of the labels, holds."""
        if self.labels is not None:
            try:
                known = names_in(locate(self.labels, base))
            except RecordingError:
                return dataclasses.replace(self, labels=None, columns={}, class_names={})
            columns = {column: name for column, name in self.columns.items() if name in known}
            names = {column: name for column, name in self.class_names.items() if column in columns}
            return dataclasses.replace(self, columns=columns, class_names=names)
        columns, class_names = npz.columns_found(self.file, base, self.columns, self.class_names)
        return dataclasses.replace(self, columns=columns, class_names=class_names)

    def content(self, base: Path) -> str:
        """Return the hashes of the file and of that of the labels."""
        files = [self.file, *([] if self.labels is None else [self.labels])]
        return " ".join(content(locate(file, base)) for file in files)

    def read(self, base: Path) -> Signals:
        """Return the recordings.

        Raises:
            RecordingError: anything wrong with the file, naming array, recording and sample.
        """
        path = locate(self.file, base)
        arrays = npz.load(path, self._names())
        offsets = None if self.offsets is None else arrays[self.offsets]
        where, signal = f"{path.name}: '{self.signal}'", arrays[self.signal]
        if offsets is None:
            signal, offsets = self._in_order(signal, where)
        flat, borders = end_to_end(signal, offsets, where)
        if self.labels is not None:
            path = locate(self.labels, base)
            arrays = load(path, self._label_names())
        columns = label_columns(arrays, self.columns, self.class_names, len(borders) - 1, path.name)
        return Signals(flat, borders, float(self.step_ms), columns)

    def _in_order(self, signal: Array, where: str) -> tuple[Array, Ints | None]:
        """Return a cube with its axes in their usual order, or recordings end to end with their borders."""
        if signal.dtype.kind == "O":
            if any(x.dtype.kind not in "biuf" or x.ndim != 2 for x in signal):
                raise RecordingError(f"{where} must hold one matrix of numbers per recording")
            if len({x.shape[1] for x in signal}) != 1:
                raise RecordingError(f"{where} must have as many channels in every recording")
            return np.concatenate(list(signal)), np.cumsum([0, *map(len, signal)])
        axes = (self.axes or "recording step channel").split()
        if signal.ndim != len(axes):
            hint = "; data.axes: recording step is one channel" if signal.ndim == 2 and not self.axes else ""
            raise RecordingError(
                f"{where} must be ({', '.join(axes)}) without offsets, got shape {signal.shape}{hint}"
            )
        if "channel" not in axes:
            signal, axes = signal[..., None], [*axes, "channel"]
        return signal.transpose([axes.index(name) for name in ("recording", "step", "channel")]), None

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
