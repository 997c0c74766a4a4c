"""Windows: where they lie, and those cut from long recordings."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from dse.base.records import Rasters, Signals, Spikes
from dse.config.settings import Window
from dse.data.recordings.windows import (
    cut,
    mean_levels,
    onset,
    place,
    without_mean,
)

SIGNALS = Signals(
    np.array([[0, 0], [1, 0], [1, -3], [9, 9], [5, 5], [5, 6], [5, 5]], dtype=np.float32),
    np.array([0, 4, 7]), 1.0, {},
)  # fmt: skip


def placed(window, lengths, used=None, onset=None):
    used = np.ones(len(lengths), dtype=bool) if used is None else np.array(used)
    *bounds, n_steps = place(window, np.array(lengths), used, None if onset is None else np.array(onset))
    return *(x.tolist() for x in bounds), n_steps


def test_middle_start_and_onset():
    lengths = [10, 13, 8]
    assert placed(Window(8), lengths) == ([1, 2, 0], [1, 2, 0], [1, 2, 0], 8)
    assert placed(Window(6, jitter_steps=2), lengths) == ([2, 3, 1], [0, 1, 0], [4, 5, 2], 6)
    assert placed(Window(6, "start", 3), lengths) == ([0, 0, 0], [0, 0, 0], [3, 3, 2], 6)
    onset = [4, 0, 1]
    assert placed(Window(6, "contact_onset", 1), lengths, None, onset) == ([4, 0, 1], [3, 0, 0], [4, 1, 2], 6)
    assert placed(Window(None), [7, 7]) == ([0, 0], [0, 0], [0, 0], 7)


def test_recordings_out_of_use_need_no_window():
    assert placed(Window(8), [3, 10], [False, True]) == ([0, 1], [0, 1], [0, 1], 8)
    assert placed(Window(None), [3, 10, 10], [False, True, True])[-1] == 10
    assert placed(Window(8, "contact_onset"), [3, 10], [False, True], [-1, 2])[0] == [0, 2]


@given(
    lengths=st.lists(st.integers(20, 60), min_size=1, max_size=6),
    n_steps=st.integers(1, 20),
    jitter=st.integers(0, 40),
    at=st.sampled_from(["start", "middle"]),
)
def test_every_crop_lies_in_its_recording(lengths, n_steps, jitter, at):
    start, low, high, _ = (np.array(x) for x in placed(Window(n_steps, at, jitter), lengths))
    assert (low >= 0).all() and (low <= start).all() and (start <= high).all()
    assert (high + n_steps <= lengths).all()
    assert (start - low <= jitter).all() and (high - start <= jitter).all()


def test_onset_compares_with_the_first_sample():
    assert onset(SIGNALS, Window(at="contact_onset", onset_threshold=3.0)).tolist() == [2, -1]
    assert onset(SIGNALS, Window(at="contact_onset", onset_threshold=1.0)).tolist() == [1, 1]


def test_levels_are_means_over_the_window_and_can_be_removed():
    levels = mean_levels(SIGNALS, np.array([1, 0]), 2)
    assert levels.tolist() == [[1.0, -1.5], [5.0, 5.5]]
    rest = without_mean(SIGNALS, levels)
    assert mean_levels(rest, np.array([1, 0]), 2).tolist() == [[0, 0], [0, 0]]
    assert rest.values.dtype == np.float32 and SIGNALS.values[3].tolist() == [9, 9]
    assert np.array_equal(np.diff(rest.values[:4], axis=0), np.diff(SIGNALS.values[:4], axis=0))


def test_lengths_that_go_together():
    assert Window(n_steps=8, cut_steps=8, every_steps=9).at == "middle"
    assert Window(cut_steps=8).n_steps is None


def signals(lengths, n_channels=2):
    n = sum(lengths)
    return Signals(
        np.arange(n * n_channels, dtype=np.float32).reshape(n, n_channels),
        np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64),
        5.0,
        {"fabric": np.array([f"f{i}" for i in range(len(lengths))]), "force": np.arange(len(lengths)) * 10},
    )


@given(
    lengths=st.lists(st.integers(1, 20), min_size=1, max_size=5),
    cut_steps=st.integers(1, 6),
    every=st.one_of(st.none(), st.integers(1, 8)),
)
def test_cutting_signals_is_the_loop(lengths, cut_steps, every):
    recorded = signals([max(length, cut_steps) for length in lengths])
    before = recorded.values.copy()
    windows = cut(recorded, Window(cut_steps=cut_steps, every_steps=every))
    assert cut(recorded, Window()) is recorded
    expected = [
        (i, k, recorded.values[a + start : a + start + cut_steps])
        for i, (a, b) in enumerate(zip(recorded.offsets, recorded.offsets[1:], strict=False))
        for k, start in enumerate(range(0, b - a - cut_steps + 1, every or cut_steps))
    ]
    assert windows.n_recordings == len(expected)
    for number, (i, k, values) in enumerate(expected):
        assert np.array_equal(windows.values[windows.offsets[number] : windows.offsets[number + 1]], values)
        found = {name: column[number] for name, column in windows.columns.items()}
        assert found == {"fabric": f"f{i}", "force": 10 * i, "recording": i, "window": k}
    assert windows.values.dtype == np.float32 and windows.offsets.dtype == np.int64 and windows.step_ms == 5
    assert np.array_equal(recorded.values, before) and "recording" not in recorded.columns


@given(
    shape=st.tuples(st.integers(1, 4), st.integers(1, 12), st.integers(1, 3)),
    cut_steps=st.integers(1, 12),
    every=st.one_of(st.none(), st.integers(1, 6)),
    rate=st.sampled_from([0.0, 0.3, 1.0]),
)
def test_cutting_rasters_is_the_loop(shape, cut_steps, every, rate):
    cut_steps = min(cut_steps, shape[1])
    raster = np.random.default_rng(1).random(shape) < rate
    windows = cut(
        Rasters(Spikes.of_dense(raster, 2.0), {"label": np.arange(shape[0])}),
        Window(cut_steps=cut_steps, every_steps=every),
    )
    expected = [
        (i, raster[i, start : start + cut_steps])
        for i in range(shape[0])
        for start in range(0, shape[1] - cut_steps + 1, every or cut_steps)
    ]
    whole = Spikes.of_dense(np.array([window for _, window in expected]), 2.0)
    for name in ("row_offsets", "channel"):
        one, other = getattr(windows.spikes, name), getattr(whole, name)
        assert np.array_equal(one, other) and one.dtype == other.dtype
    assert (windows.spikes.n_steps, windows.spikes.n_channels, windows.spikes.step_ms) == (
        cut_steps,
        shape[2],
        2.0,
    )
    assert (
        windows.columns["recording"].tolist() == [i for i, _ in expected] == windows.columns["label"].tolist()
    )
