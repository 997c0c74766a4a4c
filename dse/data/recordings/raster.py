"""Recordings that are spikes already: a 0/1 raster of one length, packed to bits along time or not."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from dse.base.records import Array, Ints, Rasters, Spikes
from dse.base.registry import fixed, register
from dse.data.recordings import RecordingError, arrays
from dse.data.recordings.source import Sampled, class_names_key


@register("recordings", "raster")
@dataclasses.dataclass(frozen=True)
class RasterFile(Sampled):
    """Spikes (0 or 1) of an .npz file, with axes in any order.

    Axes other than `sample` and `step` are flattened, in the file's order, into the input channels. An axis
    `polarity` counts planes; the others, flattened, count taxels.
    """

    array: str = fixed("spikes", doc="name of the array of spikes")
    axes: str = fixed("sample step channel", doc="names of the axes; `sample` and `step` are required")
    packed: bool = fixed(False, doc="whether the bits are packed along the step axis (numpy.packbits)")
    n_steps: int | None = fixed(
        None, doc="steps per recording (default: all in the array)", unit="steps", low=1
    )
    shape: str | None = fixed(None, doc="name of the array of the unpacked shape, instead of n_steps")
    class_names: Mapping[str, str] = class_names_key()

    def __post_init__(self) -> None:
        super().__post_init__()
        names = self.axes.split()
        if len(set(names)) < len(names) or not {"sample", "step"} <= set(names):
            raise RecordingError(
                f"data.axes must name each axis once, among them sample and step, got '{self.axes}'"
            )
        if self.shape is not None and self.n_steps is not None:
            raise RecordingError("data must have n_steps or shape, not both")

    def _names(self) -> list[str]:
        return [self.array, *([] if self.shape is None else [self.shape])]

    def _count(self, shapes: arrays.Shapes) -> int | None:
        names, shape = self.axes.split(), shapes.get(self.array, ())
        return shape[names.index("sample")] if len(shape) == len(names) else None

    def _taxels(self, shapes: arrays.Shapes) -> Ints | None:
        names, shape = self.axes.split(), shapes.get(self.array, ())
        if len(shape) != len(names):
            return None
        sizes = {name: n for name, n in zip(names, shape, strict=True) if name not in ("sample", "step")}
        places = dict(zip(sizes, np.indices(tuple(sizes.values())), strict=True))
        taxel, plane = np.zeros((2, *sizes.values()), np.int64)
        for name, number in places.items():
            if name == "polarity":
                plane = number
            else:
                taxel = taxel * sizes[name] + number
        return np.stack([taxel.ravel(), plane.ravel()], axis=1)

    def _no_channel(self) -> str:
        return f"'{self.array}' must have the axes '{self.axes}', none of length 0"

    def read(self, base: Path) -> Rasters:
        """Return the spikes."""
        path, values = self._loaded(base)
        where, raster = f"{path.name}: '{self.array}'", values[self.array]
        names = self.axes.split()
        if raster.ndim != len(names):
            raise RecordingError(f"{where} must have the axes '{self.axes}', got shape {raster.shape}")
        sample, step = names.index("sample"), names.index("step")
        n_steps = self.n_steps
        if self.shape is not None:
            shape = values[self.shape]
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
        return Rasters(spikes, self._labelled(values, len(raster), path, base))


def sparse(raster: Array, step_ms: float, where: str) -> Spikes:
    """Return the spikes of a (sample, step, channel) raster of 0 and 1."""
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
    return Spikes.of_dense(raster, step_ms)
