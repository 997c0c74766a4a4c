"""Crops as samples of their own."""

from dataclasses import replace

import numpy as np
import pytest

from dse.base.records import Spikes
from dse.models.counts.rate_windows import event_counts, event_edges_us, window_counts
from dse.models.crops import crop_starts, with_crops
from dse.testing import small


@pytest.mark.parametrize(
    ("low", "high", "n", "starts"),
    [(0, 8, 3, [0, 4, 8]), (5, 5, 4, [5]), (2, 4, 17, [2, 3, 4]), (0, 3, 2, [0, 3]), (1, 9, 1, [1])],
)
def test_crops_are_evenly_spaced(low, high, n, starts):
    assert crop_starts(low, high, n).tolist() == starts


def test_a_crop_is_the_window_that_begins_there():
    data = small.dataset(margin=2)
    more = with_crops(data, 3)
    n = len(data.train)
    assert more.train.tolist() == list(range(48, 48 + 3 * n))
    assert more.validation is data.validation and with_crops(data, 1) is data
    edges = np.arange(data.n_steps + 1)
    crops = window_counts(more.spikes, more.train, more.start[more.train], edges, "each")
    for k, shift in enumerate((-2, 0, 2)):
        begin = data.start[data.train] + shift
        expected = window_counts(data.spikes, data.train, begin, edges, "each")
        assert np.array_equal(crops[k::3], expected)
        assert more.target[more.train[k::3]].tolist() == data.target[data.train].tolist()
    before = window_counts(data.spikes, data.validation, data.start[data.validation], edges, "each")
    after = window_counts(more.spikes, data.validation, more.start[data.validation], edges, "each")
    assert np.array_equal(before, after)


def test_events_of_a_crop_have_the_times_since_its_start():
    rows = np.array([0, 0, 2, 3, 3, 4], np.int64)  # one recording of five steps of 1 ms
    times = np.array([1200, 1900, 2500, 4000], np.int32)
    spikes = Spikes(rows, np.zeros(4, np.int32), 5, 1, 1.0, times)
    one, none = np.array([1], np.int32), np.zeros(0, np.int64)
    data = replace(
        small.dataset(),
        spikes=spikes, target=np.array([0]), start=one, start_low=0 * one, start_high=2 * one, n_steps=3,
        train=np.array([0]), validation=none, test=none,
    )  # fmt: skip
    more = with_crops(data, 3)
    assert more.spikes.n_samples == 4
    edges_us = event_edges_us(3000, 0.5)
    crops = event_counts(more.spikes, more.train, more.start[more.train], edges_us, "sum")[..., 0]
    assert crops.tolist() == [[0, 0, 1, 1, 0, 1], [1, 1, 0, 1, 0, 0], [0, 1, 0, 0, 1, 0]]
