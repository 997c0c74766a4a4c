import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from dse.config.settings import Window
from dse.recordings.windows import mean_levels, place, signal_onset, without_mean
from dse.records import Signals

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


def test_signal_onset_compares_with_the_first_sample():
    assert signal_onset(SIGNALS, 3.0).tolist() == [2, -1]
    assert signal_onset(SIGNALS, 1.0).tolist() == [1, 1]


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
