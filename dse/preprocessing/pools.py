"""Which pools hold a pixel: the settings on one frame, as arrays that the kernels read."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dse.preprocessing.settings import Preprocessing, PreprocessingError, pair
from dse.records import Array

END_OF_TIME_US = 1 << 62
"""`end_us` where nothing is cut off; later than any event, and sums with times of day still fit in int64."""


@dataclass(frozen=True)
class Pooling:
    """What the settings mean on one frame.

    first_x, n_x: (frame width,) int32 first pool that holds a column, and how many do; 0 outside the crop.
    first_y, n_y: (frame height,) int32 the same for rows.
    width, height: pools along x and y.
    poles: 2 where ON and OFF are channels apart, else 1.
    only: -1 both polarities, 0 OFF alone, 1 ON alone.
    needed: events of a pool and bin that make a spike, at most 255.
    bin_us: width of a bin.
    start_us, end_us: events kept, [start, end) from t_0; bins begin at t_0 + start_us.
    rate_floor_hz: channels of a lower mean rate are silent.
    crop: x, y, width, height of the pixels that are kept.
    """

    first_x: Array
    n_x: Array
    first_y: Array
    n_y: Array
    width: int
    height: int
    poles: int
    only: int
    needed: int
    bin_us: int
    start_us: int
    end_us: int
    rate_floor_hz: float
    crop: tuple[int, int, int, int]

    @property
    def n_channels(self) -> int:
        """Channels of the raster: channel (p height + j) width + i is pool (i, j) of polarity p."""
        return self.poles * self.width * self.height

    @property
    def counts_needed(self) -> bool:
        """Whether a pool must count its events, not only see one."""
        return self.needed > 1

    def n_bins(self, duration_us: int) -> int:
        """Return the bins of a recording that lasts `duration_us` from t_0; the last may be partly empty."""
        return max(0, -(-(min(duration_us, self.end_us) - self.start_us) // self.bin_us))


def pooling(
    settings: Preprocessing, width: int, height: int, pins: tuple[int, int, int, int] | None = None
) -> Pooling:
    """Return what the settings mean on a frame.

    Along each axis, with u = x - crop_x and the kernel k cut to size + 2 padding,

        pool i holds u where  i stride - padding <= u < i stride - padding + k
        i < (size + 2 padding - k) // stride + 1

    so pools that would stick out beyond the padding are left out, and a row of taxels is pooled along x
    alone.

    Args:
        settings: section `preprocessing`.
        width: columns of the frame.
        height: rows of the frame.
        pins: x, y, width, height of the pixels that see pins; needed by `crop: pins`.

    Raises:
        PreprocessingError: the crop does not lie in the frame, or the pins are not known.
    """
    crop = settings.crop or (0, 0, width, height)
    if crop == "pins":
        if pins is None:
            raise PreprocessingError(
                "preprocessing.crop must be [x, y, width, height] where no pins are known, got pins"
            )
        crop = pins
    x, y, columns, rows = crop
    if min(x, y) < 0 or min(columns, rows) < 1 or x + columns > width or y + rows > height:
        raise PreprocessingError(
            f"preprocessing.crop must lie in the frame of {width} x {height} pixels, got x {x} to "
            f"{x + columns - 1} and y {y} to {y + rows - 1}"
        )
    kernel, padding = pair(settings.pool), pair(settings.padding)
    stride = kernel if settings.stride is None else pair(settings.stride)
    first_x, n_x, n_columns = _along(width, x, columns, kernel[0], stride[0], padding[0])
    first_y, n_y, n_rows = _along(height, y, rows, kernel[1], stride[1], padding[1])
    start_us, end_us = 0, END_OF_TIME_US
    if settings.time_ms is not None:
        start_us, end_us = (round(edge * 1000) for edge in settings.time_ms)
    return Pooling(
        first_x=first_x, n_x=n_x, first_y=first_y, n_y=n_y, width=n_columns, height=n_rows,
        poles=2 if settings.polarity == "split" else 1,
        only={"ignore_off": 1, "ignore_on": 0}.get(settings.polarity, -1),
        needed=settings.pool_threshold + settings.exceeds,
        bin_us=settings.bin_us, start_us=start_us, end_us=end_us,
        rate_floor_hz=settings.rate_floor_hz, crop=(x, y, columns, rows),
    )  # fmt: skip


def _along(
    frame: int, start: int, size: int, kernel: int, stride: int, padding: int
) -> tuple[Array, Array, int]:
    """Return first pool and number of pools of each of `frame` pixels, and the number of pools."""
    kernel = min(kernel, size + 2 * padding)
    n = (size + 2 * padding - kernel) // stride + 1
    u = np.arange(frame) - start
    first = np.maximum((u + padding - kernel) // stride + 1, 0)
    last = np.minimum((u + padding) // stride, n - 1)
    inside = (u >= 0) & (u < size) & (first <= last)
    return (
        np.where(inside, first, 0).astype(np.int32),
        np.where(inside, last - first + 1, 0).astype(np.int32),
        n,
    )
