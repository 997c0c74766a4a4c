"""Which pools hold a pixel of one frame, as arrays that the kernels read."""

from __future__ import annotations

from typing import NamedTuple

from dse.base.records import Ints

END_OF_TIME_US = 1 << 62
"""`end_us` where nothing is cut off; later than any event, and sums with times of day still fit in int64."""


class Pooling(NamedTuple):
    """The pools of one frame (made by `dse.data.recordings.pooling`).

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

    first_x: Ints
    n_x: Ints
    first_y: Ints
    n_y: Ints
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
