import json

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.show.figures import progress
from dse.show.figures.progress import ProgressFigure, gather_progress
from dse.skyline.pareto import hypervolume

OBJECTIVES = {"accuracy": "max", "energy_uj": "min"}


def table(accuracy, energy, **more):
    return pd.DataFrame(
        {"trial": range(len(accuracy)), "task": "texture", "accuracy": accuracy, "energy_uj": energy}
    ).assign(**more)


def test_hypervolume_by_hand():
    # Normalised to costs: (1, 0), (0.5, 0.5), (0.6, 0.6), (0, 1), (0.25, 0.25) of a unit square.
    points = table([0.0, 0.5, 0.4, 1.0, 0.75], [0.0, 50.0, 60.0, 100.0, 25.0])
    (curve,) = gather_progress(points, OBJECTIVES, range(5), [1, 2, 3, 4, 5])
    assert (curve.task, curve.hardware) == ("texture", "")
    # What lies on the edge of the square adds nothing, nor does what is beaten.
    assert curve.trials.tolist() == [1, 2, 4, 5]
    assert curve.hours.tolist() == [1, 2, 4, 5]
    np.testing.assert_allclose(curve.hypervolume, [0, 0.25, 0.25, 0.5625])


def test_order_is_that_of_finishing_and_the_curve_lasts_until_the_end():
    points = table([0.0, 0.5, 0.4, 1.0], [0.0, 50.0, 60.0, 100.0])
    (curve,) = gather_progress(points, OBJECTIVES, [7, 3, 0, 1, 2, 8])
    assert curve.trials.tolist() == [2, 3, 4, 6]  # trials 7, 2 and 8 changed nothing
    np.testing.assert_allclose(curve.hypervolume, [0, 0, 0.25, 0.25])
    assert np.isnan(curve.hours).all()


def test_unfinished_trials_widen_the_ranges_only():
    points = table([0.0, 0.5, 0.4, 1.0], [0.0, 50.0, 60.0, 100.0])
    (curve,) = gather_progress(points, OBJECTIVES, [1])
    assert curve.trials.tolist() == [1]
    np.testing.assert_allclose(curve.hypervolume, [0.25])


def test_every_task_and_chip_has_a_curve_and_ranges_of_its_own():
    one = table([0.0, 0.5, 1.0], [0.0, 5.0, 10.0], hardware="a")
    points = pd.concat([one, one.assign(hardware="b", energy_uj=one.energy_uj * 7), one.assign(task="speed")])
    curves = gather_progress(points, OBJECTIVES, range(3))
    assert [(c.task, c.hardware) for c in curves] == [("texture", "a"), ("texture", "b"), ("speed", "a")]
    for curve in curves:
        np.testing.assert_allclose(curve.hypervolume, [0, 0.25, 0.25])


def test_what_cannot_be_on_a_front_adds_nothing():
    points = table(
        [0.0, 1.0, 0.9, 0.9, 0.9, 0.5],
        [0.0, 10.0, 1.0, 1.0, np.nan, 5.0],
        transductive=pd.array([False, False, True, False, False, None], "boolean"),
        fits=pd.array([True, True, True, False, True, True], "boolean"),
    )
    (curve,) = gather_progress(points, OBJECTIVES, range(6))
    np.testing.assert_allclose(curve.hypervolume, [0, 0, 0.25])


def test_equal_points_and_constant_objectives():
    points = table([0.0, 0.5, 0.5, 1.0], [3.0, 3.0, 3.0, 3.0])
    (curve,) = gather_progress(points, OBJECTIVES, range(4))
    assert curve.trials.tolist() == [1, 2, 4]
    np.testing.assert_allclose(curve.hypervolume, [0, 0.5, 1])


@pytest.mark.parametrize(
    ("points", "finished"),
    [
        (pd.DataFrame(), []),
        (table([], []), []),
        (table([0.5], [1.0]), [0]),  # one point has no range
        (table([np.nan, np.nan], [np.nan, np.inf]), [0, 1]),
        (table([0.0, 1.0], [0.0, 1.0]), []),
        (table([0.0, 1.0], [0.0, 1.0]).drop(columns=["accuracy", "energy_uj"]), [0, 1]),
    ],
)
def test_nothing_to_draw(points, finished):
    found = gather_progress(points, OBJECTIVES, finished)
    assert [curve.hypervolume.tolist() for curve in found if curve.hypervolume.any()] == []
    ProgressFigure().draw(found)


@given(
    st.lists(st.tuples(st.integers(0, 6), st.integers(0, 6), st.integers(0, 6)), min_size=2, max_size=40),
    st.integers(1, 12),
)
def test_agrees_with_the_definition_and_thinning_keeps_the_end(values, steps):
    points = pd.DataFrame(values, columns=["a", "b", "c"]).assign(trial=range(len(values)))
    ways = {"a": "max", "b": "min", "c": "min"}
    costs = np.array([(-a, b, c) for a, b, c in values], float)
    varied = costs[:, np.ptp(costs, axis=0) > 0]
    if not varied.size:
        assert gather_progress(points, ways, range(len(values))) == ()
        return
    varied = (varied - varied.min(axis=0)) / np.ptp(varied, axis=0)
    slow = [hypervolume(varied[: n + 1], np.ones(varied.shape[1])) for n in range(len(values))]
    (whole,) = gather_progress(points, ways, range(len(values)))
    known = dict(zip(whole.trials.tolist(), whole.hypervolume.tolist(), strict=True))
    stepped = [known[max(t for t in known if t <= n)] for n in range(1, len(values) + 1)]
    np.testing.assert_allclose(stepped, slow, atol=1e-12)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(progress, "MAX_STEPS", steps)
        (few,) = gather_progress(points, ways, range(len(values)))
    assert len(few.trials) <= steps + 1
    np.testing.assert_allclose(few.hypervolume, [slow[n - 1] for n in few.trials], atol=1e-12)
    assert few.trials[-1] == len(values)


def test_a_front_too_large_for_its_many_objectives_is_left_out():
    rng = np.random.default_rng(0)
    ways = dict.fromkeys("abcdef", "min")
    sphere = rng.random((900, 6)) + 0.1
    points = pd.DataFrame(1 - sphere / np.linalg.norm(sphere, axis=1)[:, None], columns=list("abcdef"))
    found = gather_progress(points.assign(trial=range(900), task="texture"), ways, range(900))
    assert found == ()


def test_drawing_has_a_panel_each_and_says_whose_a_trace_is():
    one = table([0.0, 0.5, 1.0], [0.0, 5.0, 10.0], hardware="a")
    points = pd.concat([one, one.assign(hardware="b"), one.assign(task="<b>speed</b>" + "x" * 99)])
    figure = ProgressFigure().draw(gather_progress(points, OBJECTIVES, range(3), [0.5, 1.0, 1.5]))
    assert [trace.xaxis for trace in figure.data] == ["x", "x2"] * 3
    assert list(figure.data[0].x) == [1, 2, 3]
    assert list(figure.data[1].x) == [0.5, 1.0, 1.5]
    assert {trace.line.shape for trace in figure.data} == {"hv"}
    assert [trace.showlegend for trace in figure.data] == [True, False] * 3
    assert len({(trace.line.color, trace.line.dash) for trace in figure.data}) == 3
    assert figure.data[2].meta == {"task": "texture", "hardware": "b"}
    assert "<b>" not in figure.data[4].name
    assert len(figure.data[4].name) < 60
    assert figure.layout.xaxis2.title.text == "hours"
    json.loads(figure.to_json())


def test_drawing_without_hours_has_one_panel_and_one_point_is_a_marker():
    figure = ProgressFigure().draw(gather_progress(table([0.0, 0.5, 1.0], [0.0, 5.0, 10.0]), OBJECTIVES, [1]))
    (trace,) = figure.data
    assert trace.mode == "markers"
    assert not trace.showlegend
    assert "xaxis2" not in figure.layout
