from dataclasses import dataclass

import numpy as np
import pytest

from dse.base.records import Array, Block
from dse.show.figures.trial import draw_course, draw_pins, gather_trial


@dataclass
class Walk:
    """Two pins at three moments 10 ms apart; the second pin, listed first, moves right by 4 px and stays."""

    t_s: Array
    px: Array
    s_mm: Array
    v_mm_s: Array
    radius_px: float = 2.0


@pytest.fixture
def walk():
    right = [[30.0, 10.0], [34.0, 10.0], [34.0, 10.0]]
    left = [[10.0, 10.0]] * 3
    return Walk(
        np.array([0.0, 0.01, 0.02]),
        np.stack([right, left], axis=1),
        np.array([0.0, 0.5, 0.4]),
        np.array([0.0, 20.0, 30.0]),
    )


@pytest.fixture
def block():
    # time, column, row, polarity; pixel x covers x to x + 1, so at rest columns below 20 are the left pin's
    events = [
        (0, 9, 9, 1),
        (4_000, 19, 9, 0),
        (9_999, 20, 9, 1),
        (10_000, 21, 9, 0),  # the middle is at 22 by now
        (13_000, 33, 9, 1),
        (20_000, 33, 9, 1),  # not before the last moment
    ]
    t_us, x, y, polarity = np.array(events).T
    return Block(t_us, x.astype(np.int32), y.astype(np.int32), polarity.astype(np.uint8))


def test_numbers_by_hand(block, walk):
    view = gather_trial(block, walk, (40, 20), "a trial")
    assert view.px[:, 0].tolist() == [[10.0, 10.0]] * 3
    assert view.px[:, 1, 0].tolist() == [30.0, 34.0, 34.0]
    assert view.raster.tolist() == [[2, 1], [1, 1]]
    assert view.on_kev_s.tolist() == pytest.approx([0.2, 0.1])
    assert view.off_kev_s.tolist() == pytest.approx([0.1, 0.1])
    assert view.v_mm_s.tolist() == [0.0, 20.0, 30.0]
    assert view.s_mm.tolist() == [0.0, 0.5, 0.4]
    assert (view.n_events, view.one_in) == (6, 1)
    assert view.events.t_us.tolist() == [0, 4_000, 9_999, 10_000, 13_000]
    assert (view.step_ms, view.recent_ms, view.busiest) == (10.0, 10.0, 1)
    view = gather_trial(block, walk, (40, 20), "a trial", most_events=3)
    assert view.one_in == 2 and view.raster.sum() == 5, "thinned evenly and counted in full"
    assert view.events.t_us.tolist() == [0, 9_999, 13_000]


def test_moments_are_every_mth_of_the_paths():
    n = 4001
    still = Walk(np.arange(n) * 1e-4, np.zeros((n, 1, 2)), np.arange(n) / n, np.zeros(n))
    t_us = np.arange(0, 400_000, 500)
    address = np.zeros(len(t_us), np.int32)
    view = gather_trial(Block(t_us, address, address, address.astype(np.uint8)), still, (4, 4), "still")
    assert len(view.t_s) == 801
    assert view.step_ms == pytest.approx(0.5)
    assert (view.raster == 1).all()
    assert view.s_mm.tolist() == still.s_mm[::5].tolist()
    many = Walk(still.t_s, np.zeros((n, 2000, 2)), still.s_mm, still.v_mm_s)
    assert len(gather_trial(Block(*[address[:0]] * 4), many, (4, 4), "many").t_s) <= 131


def test_without_events_or_moments(block, walk):
    none = np.zeros(0, np.int32)
    empty = Block(none.astype(np.int64), none, none, none.astype(np.uint8))
    view = gather_trial(empty, walk, (40, 20), "still")
    assert view.raster.tolist() == [[0, 0], [0, 0]] and view.n_events == 0
    assert draw_course(view).data[0].zmax == 1
    assert len(draw_pins(view, 1).data[3].x) == 0
    short = Walk(walk.t_s[:1], walk.px[:1], walk.s_mm[:1], walk.v_mm_s[:1])
    with pytest.raises(ValueError, match="at least two times, got 1"):
        gather_trial(block, short, (40, 20), "short")


def test_drawing_of_a_moment(block, walk):
    before = (walk.px.copy(), block.x.copy())
    view = gather_trial(block, walk, (40, 20), "a trial")
    figure = draw_pins(view, 1)
    discs, moves, off, on = figure.data
    x = np.array(discs.x, float).reshape(2, -1)
    assert np.isnan(x[:, -1]).all()
    ends = np.nanmin(x, axis=1), np.nanmax(x, axis=1)
    assert np.round(ends, 6).tolist() == [[8, 32], [12, 36]]
    assert np.array(moves.x, float)[[0, 1, 3, 4]].tolist() == [10.0, 10.0, 30.0, 34.0]
    # later than 0 and up to 10 ms
    assert (list(off.x), list(off.y)) == ([19.5, 21.5], [9.5, 9.5])
    assert list(on.x) == [20.5]
    assert tuple(figure.layout.xaxis.range) == (0, 40)
    assert tuple(figure.layout.yaxis.range) == (20, 0)
    assert figure.layout.xaxis.title.text == "x (px)"
    _, moves, off, _ = draw_pins(view, 1, exaggeration=3.0).data
    assert np.array(moves.x, float)[[0, 1, 3, 4]].tolist() == [10.0, 10.0, 30.0, 42.0]
    assert list(off.x) == [19.5, 21.5], "events stay"
    assert (walk.px == before[0]).all() and (block.x == before[1]).all()


def test_drawing_over_time(block, walk):
    figure = draw_course(gather_trial(block, walk, (40, 20), "<b>a trial</b>"))
    heat, off, on, speed, shear = figure.data
    assert np.asarray(heat.z).tolist() == [[2, 1], [1, 1]]
    assert np.asarray(heat.x).tolist() == pytest.approx([0.005, 0.015])
    assert [line.name for line in (off, on, speed, shear)] == ["OFF events", "ON events", "speed", "shear"]
    assert np.asarray(on.y).tolist() == pytest.approx([0.2, 0.1])
    assert list(speed.y) == [0.0, 20.0, 30.0]
    titles = [figure.layout[f"yaxis{k}"].title.text for k in ("", "2", "3", "4")]
    assert titles == ["pin, along x", "kev/s", "v (mm/s)", "s (mm)"]
    assert figure.layout.xaxis4.title.text == "time (s)"
    assert heat.colorbar.title.text == "events in 10 ms"
    assert figure.layout.title.text == "&lt;b&gt;a trial&lt;/b&gt;"
