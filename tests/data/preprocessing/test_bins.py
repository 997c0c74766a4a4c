"""Bins that end as events arrive are those of a recording that is pooled as a whole."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.config.settings import Preprocessing
from dse.data.preprocessing import pool, pool_events, survey
from dse.data.preprocessing.bins import Bins
from dse.data.recordings.pooling import pooling
from tests.data.preprocessing.test_streaming import block, pieces


def run(whole, cuts, bins):
    """Push the events in blocks that end at `cuts`, empty ones among them."""
    done = [done for part in pieces(whole, cuts) for done in bins.push(part)]
    return [*done, *bins.end()]


@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(1, 60),
    cuts=st.lists(st.integers(0, 60), max_size=5),
    every_event=st.booleans(),
    polarity=st.sampled_from(["split", "merge", "ignore_off", "ignore_on"]),
    crop=st.sampled_from([None, (1, 0, 4, 3)]),
    stride=st.sampled_from([None, 1]),
    needed=st.integers(1, 3),
    time_ms=st.sampled_from([None, (0.0, 0.02), (0.007, 0.05), (0.0, 1.0)]),
    t0_us=st.sampled_from([None, 0]),
)
def test_bins_are_those_of_the_whole(
    seed, n, cuts, every_event, polarity, crop, stride, needed, time_ms, t0_us
):
    rng = np.random.default_rng(seed)
    t = np.sort(rng.integers(0, 100, n) + rng.integers(0, 50))
    rows = zip(t, rng.integers(0, 6, n), rng.integers(0, 4, n), rng.integers(0, 2, n), strict=True)
    whole = block(*rows)
    settings = Preprocessing(
        bin_ms=0.01, pool=2, stride=stride, polarity=polarity, crop=crop, time_ms=time_ms,
        pool_threshold=1 if every_event else needed, every_event=every_event,
    )  # fmt: skip
    pools = pooling(settings, 6, 4)
    done = run(whole, cuts, Bins(pools, every_event, t0_us))
    surveyed = survey([whole], pools, 2.0, t0_us)
    assert len(done) == surveyed.n_bins
    begin = int(t[0]) if t0_us is None else t0_us
    onsets = [b for b, x in enumerate(done) if x.n_events >= 2]
    assert [*onsets, -1][0] == surveyed.onset_bin
    if every_event:
        counts, channels, t_us = pool_events([whole], pools, begin, 0, len(done))
        late = [x.t_us + pools.bin_us * b for b, x in enumerate(done) if x.t_us is not None]
        assert np.array_equal(np.concatenate([*late, np.zeros(0, np.int32)]), t_us)
    else:
        counts, channels = pool([whole], pools, begin, 0, len(done))
    assert [len(x.channels) for x in done] == counts.tolist()
    assert [c for x in done for c in x.channels.tolist()] == channels.tolist()


def test_time_ends_bins_without_events():
    bins = Bins(pooling(Preprocessing(bin_ms=0.01), 4, 1))
    assert list(bins.push(block((100, 1, 0, 1)))) == []
    assert [x.channels.tolist() for x in bins.advance(131)] == [[5], [], []]
    assert [x.channels.tolist() for x in bins.push(block((139, 0, 0, 0), (140, 2, 0, 0)))] == [[0]]
    assert [x.channels.tolist() for x in bins.end()] == [[2]]
    assert list(Bins(pooling(Preprocessing(bin_ms=0.01), 4, 1)).end()) == []


def test_a_rate_floor_is_refused():
    with pytest.raises(ValueError, match="rate_floor_hz needs whole recordings"):
        Bins(pooling(Preprocessing(bin_ms=1, rate_floor_hz=5), 4, 1))
