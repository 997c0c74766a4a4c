from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.base.records import Dataset, Spikes
from dse_papers.figures.intervals import (
    DistancesFigure,
    IntervalsFigure,
    SampleIntervalsFigure,
    gather_distances,
    gather_isi,
)
from tests.saved_data import in_a_row

NONE = np.zeros(0, np.int64)


def of(x, target, start=0, classes=("a", "<b>")):
    """Return a data set of spikes (sample, step, channel) at 10 ms, its windows from `start` on."""
    n, n_steps, m = x.shape
    flat = x.reshape(-1, m)
    offsets = np.concatenate([[0], np.cumsum(flat.sum(axis=1, dtype=np.int64))])
    spikes = Spikes(offsets, np.nonzero(flat)[1].astype(np.int32), n_steps, m, 10.0)
    begin = np.full(n, start, np.int32)
    codes = np.array(target, np.int64)
    return Dataset(
        spikes, codes, classes, begin, begin, begin, n_steps - start, np.arange(n), NONE, NONE, in_a_row(m)
    )


def trains(*steps_of_channels, n_steps=12):
    x = np.zeros((len(steps_of_channels), n_steps, len(steps_of_channels[0])), bool)
    for i, sample in enumerate(steps_of_channels):
        for c, steps in enumerate(sample):
            x[i, steps, c] = True
    return x


def test_intervals_by_hand():
    data = of(trains([[0, 2, 6], [1, 4]], [[], [3]]), [0, 1])
    found = gather_isi(data, np.array([0, 1]), {"both": np.array([0, 1]), "first": np.array([0])}, n_bins=3)
    assert found.edges_ms.tolist() == [5, 15, 25, 35]
    assert found.counts.tolist() == [[[0, 1, 1], [0, 0, 0]], [[0, 1, 0], [0, 0, 0]]]
    assert found.beyond.tolist() == [[1, 0], [1, 0]]
    assert found.mean_ms[:, 0].tolist() == [30.0, 30.0]
    assert found.sd_ms[:, 0] == pytest.approx([10 * np.std([2, 4, 3]), 10.0])
    assert np.isnan(found.mean_ms[:, 1]).all() and np.isnan(found.sd_ms[:, 1]).all()


def test_a_window_sees_its_own_spikes_alone():
    x = trains([[0, 2, 5, 9]])
    found = gather_isi(of(x, [0], start=3), np.array([0]), {"all": np.array([0])})
    assert found.mean_ms.tolist() == [[40.0]]


def test_a_regular_train_does_not_vary():
    found = gather_isi(of(trains([[0, 3, 6, 9]]), [1]), np.array([0]), {"all": np.array([0])})
    assert (found.mean_ms.item(), found.sd_ms.item()) == (30.0, 0.0)


def test_kinds_of_receptors_have_their_channels():
    planes = np.array([0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5])  # two taxels, two spikes per step
    assert {
        name: x.tolist() for name, x in IntervalsFigure.groups(planes, {"kind": "receptors"}).items()
    } == {"SA": [0, 1, 6, 7], "FA rising": [2, 3, 8, 9], "FA falling": [4, 5, 10, 11]}
    merged = SampleIntervalsFigure.groups(planes, {"kind": "receptors", "sa": True})
    assert {name: x.tolist() for name, x in merged.items()} == {
        "SA": [0, 1, 6, 7],
        "FA": [2, 3, 4, 5, 8, 9, 10, 11],
    }
    without = IntervalsFigure.groups(planes[:4], {"kind": "receptors", "sa": False})
    assert {name: x.tolist() for name, x in without.items()} == {"FA rising": [0, 1], "FA falling": [2, 3]}
    assert list(IntervalsFigure.groups(planes[:4], {})) == ["plane 0", "plane 1"]


def test_binned_patterns_by_hand():
    # One channel, windows of two steps of 10 ms, patterns of two windows, looks after 20, 40 and 60 ms.
    data = of(trains([[0, 2]], [[1, 4, 5]], [[2, 3]], n_steps=6), [0, 0, 1])
    found = gather_distances(data, np.arange(3), 20.0, bin_ms=20.0, bins=2)
    assert found.time_ms.tolist() == [20, 40, 60]
    # Patterns: (1) (1) (0);  (1, 1) (1, 0) (0, 2);  (1, 0) (0, 2) (2, 0): the first window is forgotten.
    assert found.within == pytest.approx([0, 1, 5**0.5])
    assert found.between == pytest.approx([1, (2**0.5 + 5**0.5) / 2, (1 + 8**0.5) / 2])


def test_distances_of_all_spikes_so_far_by_hand():
    # Counts after 6 and 12 steps: (1, 0) (1, 1);  (2, 0) (2, 1);  (0, 1) (0, 4)
    data = of(trains([[0], [8]], [[0, 1], [8]], [[], [5, 6, 7, 8]]), [0, 0, 1])
    found = gather_distances(data, np.arange(3), 60.0, bin_ms=120.0, bins=1)
    assert found.time_ms.tolist() == [60, 120]
    assert found.within.tolist() == [1.0, 1.0]
    assert found.between == pytest.approx(
        [(2**0.5 + 5**0.5) / 2, (10**0.5 + 13**0.5) / 2]
    )  # fmt: skip
    assert found.ratio == pytest.approx(found.between)


@given(
    seed=st.integers(0, 100),
    every_ms=st.sampled_from([1.0, 25.0, 70.0, 1e4]),
    bin_ms=st.sampled_from([1.0, 30.0, 70.0, 1e4]),
    bins=st.integers(1, 4),
)
def test_distances_are_those_of_all_pairs(seed, every_ms, bin_ms, bins):
    rng = np.random.default_rng(seed)
    x = rng.random((7, 12, 3)) < 0.4
    data = of(x, rng.integers(0, 2, 7).tolist(), start=2)
    found = gather_distances(data, np.arange(7), every_ms, bin_ms, bins)
    assert found.time_ms[-1] == 100
    width = max(1, round(bin_ms / 10))
    pairs = [(i, j) for i in range(7) for j in range(i)]
    for k, time_ms in enumerate(found.time_ms):
        last = round(time_ms / 10)
        windows = [(max(0, last - (k + 1) * width), max(0, last - k * width)) for k in range(bins)]
        counts = np.stack([x[:, 2 + low : 2 + high].sum(axis=1) for low, high in windows], axis=1)
        for same, values in ((True, found.within), (False, found.between)):
            expected = [
                np.linalg.norm(counts[i] - counts[j])
                for i, j in pairs
                if (data.target[i] == data.target[j]) == same
            ]
            assert values[k] == pytest.approx(np.mean(expected) if expected else np.nan, nan_ok=True)


def test_silence_and_single_classes():
    quiet = gather_distances(of(trains([[]], [[]], [[]]), [0, 0, 1]), np.arange(3), 60.0)
    assert quiet.within.tolist() == quiet.between.tolist() == [0.0, 0.0]
    assert np.isnan(quiet.ratio).all()
    alone = gather_distances(of(trains([[1]], [[2]]), [0, 0]), np.arange(2), 120.0, 120.0)
    assert np.isnan(alone.between).all() and alone.within.tolist() == [0.0]


def test_what_they_refuse():
    data = of(trains([[1]]), [0])
    with pytest.raises(ValueError, match=r"channels of group 'x' must be in 0..0, got \[1\]"):
        gather_isi(data, np.array([0]), {"x": np.array([1])})
    with pytest.raises(ValueError, match="at least one group of channels, got none"):
        gather_isi(data, np.array([0]), {})
    timed = replace(data, spikes=replace(data.spikes, t_us=np.array([0], np.int32)))
    with pytest.raises(ValueError, match=r"spikes must be at most one per channel and step, got every event"):
        gather_isi(timed, np.array([0]), {"x": np.array([0])})
    with pytest.raises(ValueError, match="samples must be at least 2, got 1"):
        gather_distances(data, np.array([0]), 10.0)


def test_drawings_show_the_numbers():
    data = of(trains([[0, 2, 6], [1, 4]], [[0, 5], [3]]), [0, 1])
    found = gather_isi(data, np.arange(2), {"SA": np.array([0]), "FA": np.array([1])}, n_bins=4)
    figure = IntervalsFigure().draw(found)
    assert [trace.name for trace in figure.data] == ["a", "&lt;b&gt;"] * 2
    np.testing.assert_equal(np.array(figure.data[0].y), [np.nan, 0.5, np.nan, 0.5])
    assert np.isnan(figure.data[1].y).all(), "what is beyond the last bin is part of the whole"
    points = SampleIntervalsFigure().draw(found)
    assert (list(points.data[0].x), list(points.data[0].y)) == ([30.0], [pytest.approx(10.0)])
    lines = DistancesFigure().draw(gather_distances(data, np.arange(2), 60.0))
    assert [trace.name for trace in lines.data] == ["within a class", "between classes", "between / within"]
