"""Recordings that are spikes already: a 0/1 raster of one length, packed to bits along time or not."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Self

import numpy as np

from dse.recordings import RecordingError, npz
from dse.recordings.files import content, locate
from dse.recordings.labels import class_names_key, columns_key, label_columns
from dse.recordings.positions import check_positions, position_faults, positions_key, taxel_positions
from dse.records import Array, Ints, Rasters, Spikes
from dse.registry import param, register


@register("recordings", "raster")
@dataclasses.dataclass(frozen=True)
class RasterFile:
    """Spikes (0 or 1) of an .npz file, with axes in any order.

    Axes other than `sample` and `step` are flattened, in the file's order, into the input channels. An axis
    `polarity` counts planes; the others, flattened, count taxels.
    """

    file: str = param(
        doc="the .npz file: an absolute path, or relative to the YAML file or to $DSE_DATA", axis=False
    )
    step_ms: float = param(doc="duration of a step", unit="ms", low=0, low_open=True, axis=False)
    array: str = param("spikes", doc="name of the array of spikes", axis=False)
    axes: str = param(
        "sample step channel", doc="names of the axes; `sample` and `step` are required", axis=False
    )
    packed: bool = param(
        False, doc="whether the bits are packed along the step axis (numpy.packbits)", axis=False
    )
    n_steps: int | None = param(
        None, doc="steps per recording (default: all in the array)", unit="steps", low=1, axis=False
    )
    shape: str | None = param(
        None, doc="name of the array of the unpacked shape, instead of n_steps", axis=False
    )
    columns: Mapping[str, str] = columns_key()
    class_names: Mapping[str, str] = class_names_key()
    positions: tuple[tuple[int, int], ...] | None = positions_key()

    def __post_init__(self) -> None:
        check_positions(self.positions)
        names = self.axes.split()
        if len(set(names)) < len(names) or not {"sample", "step"} <= set(names):
            raise RecordingError(
                f"data.axes must name each axis once, among them sample and step, got '{self.axes}'"
            )
        if self.shape is not None and self.n_steps is not None:
            raise RecordingError("data must have n_steps or shape, not both")

    def _names(self) -> list[str]:
        shape = [] if self.shape is None else [self.shape]
        return [self.array, *shape, *self.columns.values(), *self.class_names.values()]

    def _count(self, shapes: npz.Shapes) -> int | None:
        names = self.axes.split()
        shape = shapes.get(self.array, ())
        return shape[names.index("sample")] if len(shape) == len(names) else None

    def _channels(self, shapes: npz.Shapes) -> tuple[Ints, Ints]:
        """Return number of the taxel and plane of every channel; both empty where the shape does not fit."""
        names, shape = self.axes.split(), shapes.get(self.array, ())
        if len(shape) != len(names):
            return np.zeros(0, np.int64), np.zeros(0, np.int64)
        sizes = {name: n for name, n in zip(names, shape, strict=True) if name not in ("sample", "step")}
        channel = np.arange(math.prod(sizes.values()))
        taxel, plane, stride = np.zeros_like(channel), np.zeros_like(channel), channel.size
        for name, size in sizes.items() if channel.size else ():
            stride //= size
            number = channel // stride % size
            if name == "polarity":
                plane = number
            else:
                taxel = taxel * size + number
        return taxel, plane

    def check(self, base: Path) -> list[str]:
        """Return the faults that the file's headers show."""
        faults = npz.faults(self.file, base, self._names(), self.columns, self.class_names, self._count)
        if self.positions is None or faults:
            return faults
        taxel, _ = self._channels(npz.headers(locate(self.file, base)))
        return position_faults(self.positions, int(taxel.max()) + 1) if taxel.size else []

    def with_columns_found(self, base: Path) -> Self:
        """Return the component with only the label columns that its file holds."""
        columns, class_names = npz.columns_found(self.file, base, self.columns, self.class_names)
        return dataclasses.replace(self, columns=columns, class_names=class_names)

    def content(self, base: Path) -> str:
        """Return the hash of the file."""
        return content(locate(self.file, base))

    def read(self, base: Path) -> Rasters:
        """Return the spikes.

        Raises:
            RecordingError: anything wrong with the file.
        """
        path = locate(self.file, base)
        arrays = npz.load(path, self._names())
        where = f"{path.name}: '{self.array}'"
        raster = arrays[self.array]
        names = self.axes.split()
        if raster.ndim != len(names):
            raise RecordingError(f"{where} must have the axes '{self.axes}', got shape {raster.shape}")
        sample, step = names.index("sample"), names.index("step")
        n_steps = self.n_steps
        if self.shape is not None:
            shape = arrays[self.shape]
            if shape.shape != (len(names),) or shape.dtype.kind not in "iu" or shape.min() < 1:
                raise RecordingError(
                    f"{path.name}: '{self.shape}' must hold {len(names)} integers > 0, got {shape}"
                )
            n_steps = int(shape[step])
        if self.packed and raster.dtype != np.uint8:
            raise RecordingError(f"{where} must be uint8 to be packed bits, got {raster.dtype}")
        available = raster.shape[step] * (8 if self.packed else 1)
        if n_steps is not None and n_steps > available:
            raise RecordingError(f"{where} must hold {n_steps} steps, got {available}")
        if self.packed:
            raster = np.unpackbits(raster, axis=step)
        raster = np.moveaxis(raster, (sample, step), (0, 1))[:, :n_steps]
        spikes = sparse(
            raster.reshape(*raster.shape[:2], math.prod(raster.shape[2:])), float(self.step_ms), where
        )
        return Rasters(spikes, label_columns(arrays, self.columns, self.class_names, len(raster), path.name))

    def channel_positions(self, base: Path) -> Ints:
        """Return x, y and plane of every channel.

        Raises:
            RecordingError: the file cannot be read, or positions are given for another number of taxels.
        """
        path = locate(self.file, base)
        taxel, plane = self._channels(npz.headers(path))
        if not taxel.size:
            raise RecordingError(
                f"{path.name}: '{self.array}' must have the axes '{self.axes}', none of length 0"
            )
        return taxel_positions(self.positions, taxel, plane)


def sparse(raster: Array, step_ms: float, where: str) -> Spikes:
    """Return the spikes of a (sample, step, channel) raster of 0 and 1.

    Raises:
        RecordingError: another value, or no sample, step or channel.
    """
    if 0 in raster.shape:
        raise RecordingError(f"{where} must hold samples, steps and channels, got shape {raster.shape}")
    if raster.dtype.kind not in "biuf":
        raise RecordingError(f"{where} must hold 0 and 1, got {raster.dtype}")
    bad = (raster != 0) & (raster != 1)
    if bad.any():
        i, t, c = (int(x) for x in np.argwhere(bad)[0])
        raise RecordingError(
            f"{where} must be 0 or 1, got {raster[i, t, c]} in recording {i}, step {t}, channel {c}"
        )
    rows = np.count_nonzero(raster, axis=2).ravel()
    offsets = np.concatenate([[0], np.cumsum(rows)]).astype(np.int64)
    n_steps, n_channels = raster.shape[1:]
    return Spikes(offsets, np.nonzero(raster)[2].astype(np.int32), n_steps, n_channels, step_ms)
