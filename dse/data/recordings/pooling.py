"""Section `preprocessing` on the frame of a source: which pools hold a pixel."""

from __future__ import annotations

import numpy as np

from dse.base.records import Ints
from dse.config.settings import Preprocessing, pair
from dse.data.preprocessing import END_OF_TIME_US, Pooling
from dse.data.recordings import RecordingError


def pooling(
    settings: Preprocessing, width: int, height: int, pins: tuple[int, int, int, int] | None = None
) -> Pooling:
    """Return the pools of the settings on a frame of pixels, of which some see `pins`: x, y, width, height.

    Along each axis, with u = x - crop_x and the kernel k cut to size + 2 padding,

        pool i holds u where  i stride - padding <= u < i stride - padding + k
        i < (size + 2 padding - k) // stride + 1

    so pools that would stick out beyond the padding are left out, and a row of taxels is pooled along x
    alone.

    Raises:
        RecordingError: the crop does not lie in the frame, or is `pins`, which are not known.
    """
    crop = settings.crop or (0, 0, width, height)
    if crop == "pins":
        if pins is None:
            raise RecordingError(
                "preprocessing.crop must be [x, y, width, height], because the positions of pins are "
                "unknown, got pins"
            )
        crop = pins
    x, y, columns, rows = crop
    if min(x, y) < 0 or min(columns, rows) < 1 or x + columns > width or y + rows > height:
        raise RecordingError(
            f"preprocessing.crop must lie within the frame of {width} x {height} pixels, got x {x} to "
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
) -> tuple[Ints, Ints, int]:
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
