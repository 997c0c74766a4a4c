import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.config.settings import Preprocessing
from dse.data.preprocessing import pool_events
from dse.data.recordings.pooling import pooling
from tests.data.preprocessing.test_streaming import block, cases, definition, pieces


def test_each_event_is_a_spike_at_its_own_time():
    # Bins of 10 us from 1003 us on; the event at 1002 us comes before them, that at 1023 us after two.
    whole = block(
        (1002, 0, 0, 1), (1003, 4, 0, 1), (1003, 0, 0, 0), (1003, 1, 0, 1), (1013, 5, 0, 1), (1023, 0, 0, 1)
    )
    pools = pooling(Preprocessing(bin_ms=0.01, pool=(2, 1), every_event=True), 6, 1)
    counts, channels, t_us = pool_events([whole], pools, 1000 + 3, 0, 2)
    assert counts.tolist() == [3, 1]
    assert channels.tolist() == [3 + 2, 0, 3, 3 + 2], "ON behind OFF; two events of a pool and bin are two"
    assert t_us.tolist() == [0, 0, 0, 10]
    assert (counts.dtype, channels.dtype, t_us.dtype) == (np.int64, np.int32, np.int32)
    later = pool_events([whole], pools, 1000 + 3, 1, 2)
    assert [x.tolist() for x in later] == [[1, 1], [5, 3], [0, 10]], "times count from the first bin kept"


def test_an_event_is_a_spike_of_every_pool_that_holds_it():
    # Pools of 2 x 2 at a stride of 1 on 3 x 2 pixels: two along x, one along y.
    pools = pooling(Preprocessing(bin_ms=1, pool=2, stride=1, polarity="merge", every_event=True), 3, 2)
    counts, channels, t_us = pool_events([block((0, 1, 1, 0), (7, 2, 0, 1))], pools, 0, 0, 1)
    assert (counts.tolist(), channels.tolist(), t_us.tolist()) == ([3], [0, 1, 1], [0, 0, 7])


@given(case=cases(), first_bin=st.integers(0, 3), n_bins=st.integers(1, 12))
def test_counted_in_bins_they_are_the_pooled_counts(case, first_bin, n_bins):
    whole, settings, width, height, t0_us, cuts = case
    for needed in (1, 2):
        binned = dataclasses.replace(settings, pool_threshold=needed, exceeds=False, rate_floor_hz=0.0)
        pools = pooling(binned, width, height)
        counts, channels, t_us = pool_events(pieces(whole, cuts), pools, t0_us, first_bin, n_bins)
        assert (np.diff(t_us) >= 0).all()
        step = np.repeat(np.arange(n_bins), counts)
        assert np.array_equal(step, t_us // settings.bin_us)
        found = np.zeros((n_bins, pools.n_channels), int)
        np.add.at(found, (step, channels), 1)
        expected = definition(whole, binned, width, height, t0_us, first_bin, n_bins)
        assert np.array_equal(found >= needed, expected)


def test_no_events_and_no_bins():
    pools = pooling(Preprocessing(bin_ms=1), 3, 2)
    for blocks, n_bins in (([], 2), ([block()], 2), ([block((0, 1, 1, 0))], 0)):
        counts, channels, t_us = pool_events(blocks, pools, 0, 0, n_bins)
        assert (counts.tolist(), channels.size, t_us.size) == ([0] * n_bins, 0, 0)


def test_windows_that_int32_cannot_hold_are_refused():
    with pytest.raises(ValueError, match="windows of more than 35 minutes, got 60"):
        pool_events([], pooling(Preprocessing(bin_ms=1000), 3, 2), 0, 0, 3600)


@pytest.mark.parametrize(
    ("keys", "values"),
    [
        ({"pool_threshold": 2}, "2, false and 0"),
        ({"exceeds": True}, "1, true and 0"),
        ({"rate_floor_hz": 1.5}, "1, false and 1.5"),
    ],
)
def test_it_excludes_what_leaves_events_out(keys, values):
    with pytest.raises(ValueError, match=f"^every_event needs pool_threshold 1, .*, got {values}$"):
        Preprocessing(bin_ms=1, every_event=True, **keys)
