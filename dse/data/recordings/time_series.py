"""Sampled recordings in arrays, end to end or in a cube, and in a table with a row per recording."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from dse.base.records import Array, Ints, Signals
from dse.base.registry import fixed, register
from dse.data.recordings import RecordingError, arrays
from dse.data.recordings.source import Sampled, class_names_key, end_to_end, in_a_row, unpadded

USUAL_AXES = ("recording", "step", "channel")
FRAMES = ("recording", "step", "row", "column")


@register("recordings", "time_series")
@dataclasses.dataclass(frozen=True)
class TimeSeries(Sampled):
    """Sampled recordings of an .npz, .npy, .mat, .h5 or .ts file.

    `signal` is (sum of lengths, channel) with `offsets`, recording i being signal[offsets[i]:offsets[i+1]],
    or (recording, sample, channel) without; `axes` names other orders. The array of an .npy file is named
    `array`; a cell of matrices in an .mat file holds recordings of different lengths.
    """

    signal: str = fixed("signal", doc="name of the array of samples")
    offsets: str | None = fixed(
        None,
        doc="name of the array of the n + 1 borders between recordings (default: a cube, recordings of one "
        "length)",
    )
    class_names: Mapping[str, str] = class_names_key()
    axes: str | None = fixed(
        None,
        doc="order of the axes of a cube, e.g. 'step channel recording' or 'recording step row column'; "
        "those beside recording and step are flattened into channels (default: recording step channel)",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.axes is not None and self.offsets is not None:
            raise RecordingError("data.axes must be absent where data.offsets is given")
        if self.axes is not None and not are_axes(self.axes.split()):
            raise RecordingError(
                f"data.axes must name each axis once, among them recording and step, got '{self.axes}'"
            )

    def _names(self) -> list[str]:
        return [self.signal, *([] if self.offsets is None else [self.offsets])]

    def _sizes(self, shapes: arrays.Shapes) -> dict[str, int]:
        """Return the sizes of the axes that are known."""
        shape, names = shapes.get(self.signal, ()), list(USUAL_AXES)
        if self.offsets is not None:
            borders = shapes.get(self.offsets)
            known = {"recording": borders[0] - 1} if borders else {}
            return known | ({"channel": shape[-1]} if len(shape) == 2 else {})
        names = self.axes.split() if self.axes is not None else names
        if len(shape) != len(names):
            return {"recording": shape[0]} if shape else {}
        sizes = dict(zip(names, shape, strict=True))
        n_channels = math.prod(size for name, size in sizes.items() if name not in USUAL_AXES[:2])
        return {"recording": sizes["recording"], "channel": n_channels}

    def _count(self, shapes: arrays.Shapes) -> int | None:
        return self._sizes(shapes).get("recording")

    def _taxels(self, shapes: arrays.Shapes) -> Ints | None:
        return in_a_row(self._sizes(shapes).get("channel"))

    def read(self, base: Path) -> Signals:
        """Return the recordings."""
        path, values = self._loaded(base)
        where, signal = f"{path.name}: '{self.signal}'", values[self.signal]
        if self.offsets is None:
            hint = "" if self.axes or signal.ndim != 2 else "; data.axes: recording step is one channel"
            flat, borders = of_cube(signal, self.axes, where, hint)
        else:
            flat, borders = end_to_end(signal, values[self.offsets], where)
        columns = self._labelled(values, len(borders) - 1, path, base)
        return Signals(flat, borders, float(self.step_ms), columns)


def are_axes(names: Sequence[str]) -> bool:
    """Return whether these are the axes of a cube, in any order; one channel needs no axis."""
    return len({*names}) == len(names) and {*USUAL_AXES[:2]} <= {*names}


def of_cube(signal: Array, axes: str | None, where: str, hint: str = "") -> tuple[Array, Ints]:
    """Return samples end to end and their borders (`source.end_to_end`) of recordings in one array.

    signal: a cube, or an array of objects, each (step, channel). axes: of a cube; None: recording, step,
    channel. hint: what to add where the cube has another number of axes.

    Raises:
        RecordingError: other axes, other channels, or what `end_to_end` refuses.
    """
    if signal.dtype.kind == "O":
        if any(x.dtype.kind not in "biuf" or x.ndim != 2 for x in signal):
            raise RecordingError(f"{where} must hold one matrix of numbers per recording")
        if other := next((i for i, x in enumerate(signal) if x.shape[1] != signal[0].shape[1]), 0):
            raise RecordingError(
                f"{where} must have as many channels in every recording, got {signal[0].shape[1]} in "
                f"recording 0 and {signal[other].shape[1]} in recording {other}"
            )
        return end_to_end(np.concatenate(list(signal)), np.cumsum([0, *map(len, signal)]), where)
    names = axes.split() if axes else list(USUAL_AXES)
    if signal.ndim != len(names):
        raise RecordingError(
            f"{where} must be ({', '.join(names)}) without offsets, got shape {signal.shape}{hint}"
        )
    signal = np.moveaxis(signal, [names.index(name) for name in USUAL_AXES[:2]], [0, 1])
    return end_to_end(signal.reshape(*signal.shape[:2], math.prod(signal.shape[2:])), None, where)


@register("recordings", "wide_table")
@dataclasses.dataclass(frozen=True)
class WideTable(Sampled):
    """Sampled recordings of a CSV or Parquet table with one row per recording: its labels and its samples.

    The samples of a channel are the columns whose names are a text and a number, in the order of the numbers:
    `left_0`, `left_1`, ... Cells that are empty at the end make a recording shorter.
    """

    samples: tuple[str, ...] = fixed(
        doc="beginning of the names of the sample columns, one per channel: `left_` stands for left_0, "
        "left_1, ...; an empty text for columns that are named by numbers alone"
    )

    def __post_init__(self) -> None:
        if not self.samples:
            raise RecordingError("data.samples must contain the beginning of a name, got none")
        super().__post_init__()

    def _names(self) -> list[str]:
        return []

    def _taxels(self, shapes: arrays.Shapes) -> Ints | None:
        return in_a_row(len(self.samples))

    def _more_faults(self, path: Path, shapes: arrays.Shapes) -> list[str]:
        lengths = {start: len(sample_columns(list(shapes), start)) for start in self.samples}
        faults = [
            f"{path.name}: no column is named '{start}' and a number, as data.samples says"
            for start, n in lengths.items()
            if not n
        ]
        if len(set(lengths.values()) - {0}) > 1:
            texts = ", ".join(f"{n} of '{start}'" for start, n in lengths.items())
            faults.append(
                f"{path.name}: channels must have as many sample columns as each other, got {texts}"
            )
        return faults

    def read(self, base: Path) -> Signals:
        """Return the recordings."""
        for fault in self.check(base):
            raise RecordingError(fault)
        path, values = self._loaded(base)
        known = arrays.column_names(path)
        names = [sample_columns(known, start) for start in self.samples]
        values |= arrays.load(path, [name for channel in names for name in channel])
        if not len(values[names[0][0]]):
            raise RecordingError(f"{path.name}: the table has no rows")
        columns = self._labelled(values, len(values[names[0][0]]), path, base)
        for name in (name for channel in names for name in channel if values[name].dtype.kind not in "biuf"):
            arrays.numbers(values[name], name, path)
        cube: Array = np.array([[values[x] for x in channel] for channel in names], np.float64)
        cube = cube.transpose(2, 1, 0)
        is_sample, lengths = ~np.isnan(cube), unpadded(cube)
        lasts = np.arange(cube.shape[1])[None, :] < lengths[:, None]
        gaps = lasts[..., None] & ~is_sample
        if gaps.any() or not lengths.all():
            row, step, channel = (int(x) for x in np.argwhere(gaps if gaps.any() else ~is_sample)[0])
            raise RecordingError(
                f"{path.name}: column '{names[channel][step]}' must hold a number in "
                f"{arrays.place(path, row)}, got none"
            )
        flat, borders = end_to_end(cube[lasts], np.concatenate([[0], np.cumsum(lengths)]), path.name)
        return Signals(flat, borders, float(self.step_ms), columns)


def sample_columns(names: Sequence[str], start: str) -> list[str]:
    """Return the columns that are named by a text and a number, in the order of the numbers."""
    matches = [(match, name) for name in names if (match := re.fullmatch(rf"{re.escape(start)}(\d+)", name))]
    return [name for match, name in sorted(matches, key=lambda pair: int(pair[0][1]))]
