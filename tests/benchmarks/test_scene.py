import numpy as np
import pytest

from benchmarks.scene import pooled, van_rossum
from dse.records import Block


def block(t_us, x, y):
    return Block(
        np.array(t_us, np.int64),
        np.array(x, np.int32),
        np.array(y, np.int32),
        np.zeros(len(x), np.uint8),
    )


def test_events_are_counted_in_pools_of_4_pixels_that_lie_in_the_frame():
    found = pooled(block([0, 900, 1000, 1999, 500], [0, 3, 4, 7, 9], [0, 3, 0, 3, 0]), (10, 5), 2.0)
    np.testing.assert_array_equal(found, [[2, 0], [0, 2]])


def test_van_rossum_distance_of_shifted_spikes_is_known():
    """Of single spikes dt apart: |f - g|^2 = (1 - exp(-dt / tau)) 2 |f|^2."""
    a, b = np.zeros((2000, 1)), np.zeros((2000, 1))
    a[5], b[12] = 1, 1
    assert van_rossum(a, b, 10.0) == pytest.approx(np.sqrt(2 * (1 - np.exp(-0.7))), rel=1e-6)
    assert van_rossum(b, b, 10.0) == 0
