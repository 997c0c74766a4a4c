import numpy as np
import pytest

from dse.config.settings import Preprocessing
from dse.data.preprocessing import END_OF_TIME_US
from dse.data.recordings.pooling import pooling


def members(first, n, n_pools):
    """The pixels of every pool along an axis."""
    return [[u for u in range(len(first)) if first[u] <= i < first[u] + n[u]] for i in range(n_pools)]


@pytest.mark.parametrize(
    ("size", "pool", "stride", "padding", "pools"),
    [
        (8, 4, None, 0, [[0, 1, 2, 3], [4, 5, 6, 7]]),
        (10, 4, 4, 0, [[0, 1, 2, 3], [4, 5, 6, 7]]),  # the third would stick out
        (6, 4, 2, 0, [[0, 1, 2, 3], [2, 3, 4, 5]]),
        (7, 2, 5, 0, [[0, 1], [5, 6]]),  # stride > kernel: pixels in no pool
        (1, 4, 4, 0, [[0]]),
        (3, 4, 2, 0, [[0, 1, 2]]),
        (6, 4, 4, 1, [[0, 1, 2], [3, 4, 5]]),  # (6 + 2 - 4) // 4 + 1
        (5, 3, 2, 1, [[0, 1], [1, 2, 3], [3, 4]]),
        (3, 4, 1, 1, [[0, 1, 2], [0, 1, 2]]),  # the kernel fits the padded axis
        (1, 4, 4, 1, [[0]]),
        (1, 9, 1, 2, [[0]]),
        (2, 1, 1, 0, [[0], [1]]),
    ],
)
def test_pixels_of_every_pool(size, pool, stride, padding, pools):
    settings = Preprocessing(1, pool=(pool, 1), stride=None if stride is None else (stride, 1),
                             padding=(padding, 0))  # fmt: skip
    along_x = pooling(settings, size, 2)
    assert members(along_x.first_x, along_x.n_x, along_x.width) == pools
    assert (along_x.width, along_x.height) == (len(pools), 2)
    turned = Preprocessing(1, pool=(1, pool), stride=None if stride is None else (1, stride),
                           padding=(0, padding))  # fmt: skip
    along_y = pooling(turned, 2, size)
    assert members(along_y.first_y, along_y.n_y, along_y.height) == pools


def test_pools_lie_in_the_crop():
    pools = pooling(Preprocessing(1, pool=2, crop=(3, 1, 5, 2)), 10, 4)
    assert (pools.width, pools.height, pools.n_channels) == (2, 1, 4)
    assert members(pools.first_x, pools.n_x, 2) == [[3, 4], [5, 6]]
    assert members(pools.first_y, pools.n_y, 1) == [[1, 2]]
    assert pools.first_x.dtype == pools.n_y.dtype == np.int32


def test_padding_of_a_crop_is_empty_although_the_frame_goes_on():
    pools = pooling(Preprocessing(1, pool=3, stride=2, padding=1, crop=(2, 1, 5, 3)), 10, 6)
    assert members(pools.first_x, pools.n_x, pools.width) == [[2, 3], [3, 4, 5], [5, 6]]
    assert members(pools.first_y, pools.n_y, pools.height) == [[1, 2], [2, 3]]


def test_the_pins_are_a_crop():
    given = pooling(Preprocessing(1, crop=(2, 0, 3, 3)), 8, 4)
    pins = pooling(Preprocessing(1, crop="pins"), 8, 4, pins=(2, 0, 3, 3))
    assert given.crop == pins.crop == (2, 0, 3, 3)
    assert np.array_equal(given.n_x, pins.n_x)
    # Pins that nobody asked for change nothing.
    assert pooling(Preprocessing(1), 8, 4, pins=(2, 0, 3, 3)).crop == (0, 0, 8, 4)


def test_what_the_kernels_read():
    pools = pooling(Preprocessing(2.5, pool_threshold=3, exceeds=True, polarity="ignore_on"), 3, 2)
    assert (pools.needed, pools.counts_needed) == (4, True)
    assert (pools.poles, pools.only, pools.n_channels) == (1, 0, 6)
    assert (pools.bin_us, pools.start_us, pools.end_us) == (2500, 0, END_OF_TIME_US)
    plain = pooling(Preprocessing(1), 3, 2)
    assert (plain.needed, plain.counts_needed, plain.poles, plain.only) == (1, False, 2, -1)
    assert pooling(Preprocessing(1, polarity="ignore_off"), 3, 2).only == 1
    assert pooling(Preprocessing(1, polarity="merge"), 3, 2).only == -1


def test_bins_of_a_duration():
    for time_ms, bins in {
        None: {0: 0, 1: 1, 30: 3, 31: 4},
        (0.0, 0.02): {1000: 2},
        (0.0, 0.025): {1000: 3},  # the last bin is partly empty
        (0.005, 0.025): {1000: 2, 16: 2, 5: 0, 6: 1},
    }.items():
        pools = pooling(Preprocessing(0.01, time_ms=time_ms), 1, 1)
        assert {duration_us: pools.n_bins(duration_us) for duration_us in bins} == bins
