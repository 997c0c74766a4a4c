"""Changed windows by hand, and against a plain definition."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.engine.augment import Shifts, Windows, changed, shifts_of
from dse.testing.small import spikes_of


def dense(spikes):
    out = np.zeros((len(spikes.row_offsets) - 1, spikes.n_channels), np.int64)
    np.add.at(out, (np.repeat(np.arange(len(out)), np.diff(spikes.row_offsets)), spikes.channel), 1)
    return out.reshape(-1, spikes.n_steps, spikes.n_channels)


def whole(samples, start, n_steps):
    return Windows(samples, start, start, start + n_steps)


def drawn(rng, n, n_steps, n_channels):
    return rng.random((n, n_steps, n_channels)) < 0.3


def shown(x, windows, others, cut, n_steps, factor=None, moved=None, table=None, dropped=0.0):
    n = len(cut)
    to = np.arange(x.shape[2], dtype=np.int32)[None] if table is None else table
    found = changed(
        spikes_of(x, 5.0),
        windows,
        others,
        cut,
        np.ones(n) if factor is None else factor,
        np.zeros(n, int) if moved is None else moved,
        Shifts(to, np.array([(np.diff(row[row >= 0]) > 0).all() for row in to])),
        n_steps,
        dropped,
        np.random.default_rng(3),
    )
    return dense(found)


def one(x, n_steps, *, factor=1.0, moved=0, table):
    """Return the first sample's middle window, changed; all stored steps may be shown."""
    at = np.array([0])
    windows = Windows(at, at + (x.shape[1] - n_steps) // 2, at, at + x.shape[1])
    found = shown(x, windows, windows, at + n_steps, n_steps, np.array([factor]), at + moved, table)
    return found[0]


NO_MOVE = np.arange(4, dtype=np.int32)[None]


def test_without_a_change_windows_are_as_they_are():
    x = drawn(np.random.default_rng(0), 3, 12, 4)
    samples, start = np.array([2, 0]), np.array([1, 4])
    windows = whole(samples, start, 7)
    found = shown(x, windows, windows, np.full(2, 7), 7)
    np.testing.assert_array_equal(found, [x[2, 1:8], x[0, 4:11]])


def test_a_window_goes_on_as_another_one():
    x = drawn(np.random.default_rng(1), 2, 10, 4)
    first, other = whole(np.array([0]), np.array([1]), 6), whole(np.array([1]), np.array([3]), 6)
    found = shown(x, first, other, np.array([2]), 6)
    np.testing.assert_array_equal(found[0], np.concatenate([x[0, 1:3], x[1, 5:9]]))


def test_stretching_to_the_double_leaves_every_other_step_silent():
    x = np.zeros((1, 8, 4), bool)
    x[0, :, 1] = True
    found = one(x, 8, factor=2.0, table=NO_MOVE)
    np.testing.assert_array_equal(found[:, 1], [0, 1, 0, 1, 0, 1, 0, 1])  # steps 2 .. 5 at 1, 3, 5, 7


def test_shrinking_shows_more_of_the_recording_and_joins_spikes_of_a_step():
    x = np.zeros((1, 8, 4), bool)
    x[0, [0, 1, 3, 4], 0] = True
    x[0, 5, 2] = True
    found = one(x, 4, factor=0.5, table=NO_MOVE)  # steps 0 1 | 2 3 | 4 5 | 6 7
    np.testing.assert_array_equal(found[:, 0], [1, 1, 1, 0])
    np.testing.assert_array_equal(found[:, 2], [0, 0, 1, 0])


def test_steps_that_may_not_be_shown_are_silent():
    x = np.ones((1, 8, 4), bool)
    at = np.array([0])
    windows = Windows(at, at + 2, at + 2, at + 6)
    found = shown(x, windows, windows, at + 4, 4, np.array([0.5]))
    np.testing.assert_array_equal(found[0, :, 0], [0, 1, 1, 0])


def test_the_array_moves_by_whole_places_and_loses_its_border():
    # x x       2 x 2 places of pitch 10 in plane 0, two of them in plane 1 and one channel of its own
    positions = np.array([[0, 0, 0], [10, 0, 0], [0, 10, 0], [10, 10, 0], [0, 0, 1], [10, 0, 1], [0, 0, 7]])
    shifts = shifts_of(positions, 1)
    assert shifts.to.shape == (9, 7) and shifts.keeps_order.all()
    np.testing.assert_array_equal(shifts.to[0], np.arange(7))
    rows = {tuple(row) for row in shifts.to.tolist()}
    assert (1, -1, 3, -1, 5, -1, 6) in rows  # one place along x
    assert (2, 3, -1, -1, -1, -1, 6) in rows  # one place along y
    assert (-1, -1, -1, 0, -1, -1, 6) in rows  # back along both
    np.testing.assert_array_equal(shifts_of(positions, 0).to, np.arange(7)[None])
    crossed = shifts_of(np.array([[0, 0, 0], [2, 0, 0], [1, 0, 0]]), 1)  # a row whose numbers do not rise
    np.testing.assert_array_equal(crossed.to[1:], [[-1, 2, 0], [2, -1, 1]])
    np.testing.assert_array_equal(crossed.keeps_order, [True, False, False])


def test_moved_spikes_stay_sorted():
    x = np.zeros((1, 3, 4), bool)
    x[0, 1] = [1, 1, 0, 1]
    table = np.array([[0, 1, 2, 3], [3, 0, -1, 1]], np.int32)
    found = one(x, 3, moved=1, table=table)
    np.testing.assert_array_equal(found[1], [1, 1, 0, 1])


@given(seed=st.integers(0, 2**32 - 1), factor=st.floats(0.5, 2.0), n_steps=st.integers(1, 9))
def test_stretching_follows_its_equation(seed, factor, n_steps):
    x = drawn(np.random.default_rng(seed), 1, n_steps + 6, 4)
    expected = np.zeros((n_steps, 4), np.int64)
    for s in range(-3, n_steps + 3):
        t = math.floor(n_steps / 2 + factor * (s + 0.5 - n_steps / 2))
        if 0 <= t < n_steps and s + 3 < x.shape[1]:
            expected[t] |= x[0, s + 3]
    np.testing.assert_array_equal(one(x, n_steps, factor=factor, table=NO_MOVE), expected)


@pytest.mark.parametrize("moved", [0, 1])
def test_a_share_of_the_spikes_is_dropped_and_the_rest_stays_in_place(moved):
    x = drawn(np.random.default_rng(2), 20, 50, 8)
    windows = whole(np.arange(20), np.zeros(20, int), 50)
    table = np.array([np.arange(8), np.arange(8)[::-1]], np.int32)
    found = shown(
        x, windows, windows, np.full(20, 50), 50, moved=np.full(20, moved), table=table, dropped=0.25
    )
    before = x[:, :, ::-1] if moved else x
    assert (found <= before).all()
    assert found.sum() / x.sum() == pytest.approx(0.75, abs=0.03)


def test_silence_stays_silent():
    windows = whole(np.arange(1), np.zeros(1, int), 3)
    assert not shown(np.zeros((1, 3, 2), bool), windows, windows, np.full(1, 3), 3, dropped=0.5).any()
