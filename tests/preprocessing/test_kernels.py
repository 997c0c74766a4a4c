from __future__ import annotations

import numpy as np
import pytest

from dse.config.settings import Preprocessing
from dse.preprocessing.kernels import MOST, add, flush
from dse.recordings.pooling import pooling


def bins(n_slots, pools):
    words = np.zeros((n_slots, (pools.n_channels + 63) // 64), dtype=np.uint64)
    return words, np.zeros((n_slots, pools.n_channels if pools.counts_needed else 0), dtype=np.uint8)


def put(slot, x, y, pole, pools, words, counts):
    where = (pools.first_x, pools.n_x, pools.first_y, pools.n_y, pools.width, pools.height)
    add(slot, x, y, pole, *where, words, counts)


def taken(slot, pools, words, counts):
    channels = np.full(pools.n_channels, -1, dtype=np.int32)
    return channels[: flush(slot, pools.needed, words, counts, channels, 0)].tolist()


@pytest.mark.parametrize("needed", [1, 2])
def test_slots_are_apart_and_channels_sorted(needed):
    pools = pooling(Preprocessing(1, pool_threshold=needed), 20, 10)
    words, counts = bins(2, pools)
    for x, y, pole in ((19, 9, 1), (4, 3, 0), (3, 3, 0), (0, 0, 0)):
        for _ in range(needed):
            put(1, x, y, pole, pools, words, counts)
    put(0, 5, 5, 0, pools, words, counts)
    # 63 and 64 lie in different words, 399 is the last channel.
    assert taken(1, pools, words, counts) == [0, 63, 64, 399]
    assert taken(0, pools, words, counts) == ([105] if needed == 1 else [])
    assert not words.any() and not counts.any()


def test_flushing_appends():
    pools = pooling(Preprocessing(1), 3, 1)
    words, counts = bins(1, pools)
    put(0, 2, 0, 0, pools, words, counts)
    channels = np.array([7, 7, -1, -1, -1, -1, -1, -1], dtype=np.int32)
    assert flush(0, 1, words, counts, channels, 2) == 3
    assert channels[:4].tolist() == [7, 7, 2, -1]


def test_counts_stop():
    pools = pooling(Preprocessing(1, pool_threshold=2), 3, 1)
    words, counts = bins(1, pools)
    for _ in range(MOST + 5):
        put(0, 1, 0, 1, pools, words, counts)
    assert counts[0].tolist() == [0, 0, 0, 0, MOST, 0]


def test_a_pixel_outside_the_crop_is_in_no_pool():
    pools = pooling(Preprocessing(1, crop=(1, 0, 2, 1)), 4, 1)
    words, counts = bins(1, pools)
    put(0, 0, 0, 1, pools, words, counts)
    put(0, 3, 0, 0, pools, words, counts)
    assert not words.any()
