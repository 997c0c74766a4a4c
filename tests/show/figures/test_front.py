import numpy as np
import pandas as pd
import pytest

from dse.show.figures.front import FrontFigure, interval
from tests.figure_data import study
from tests.page_data import ENERGY, ON_PAIR, points


def gathered(frame, columns=("energy_uj", "accuracy"), **keys):
    return FrontFigure(tuple(columns), **keys).gather(study(frame))


def draw(*arguments, **keys):
    return FrontFigure().draw(gathered(*arguments, **keys))


def test_front_is_over_the_columns_shown_of_each_task():
    front = gathered(points())
    assert front.on_front.tolist() == ON_PAIR and front.values[:, 0].tolist() == ENERGY
    both = pd.concat([points(), points(task="velocity", accuracy=0.1)], ignore_index=True)
    front = gathered(both)
    assert front.groups == ("texture", "velocity")
    assert front.on_front[front.group == 0].tolist() == ON_PAIR
    assert front.on_front[front.group == 1].tolist() == [False, False, False, True, False]


def test_rows_without_a_value_are_counted_and_not_shown():
    front = gathered(points(energy_uj=[50, np.nan, 21, np.inf, 30]))
    assert front.n_left_out == 2
    assert len(front.values) == 3
    assert front.on_front.tolist() == [True, True, True]


def test_intervals_are_distances_from_the_value():
    low, high = interval(points(), "energy_uj")
    np.testing.assert_allclose(low, np.array(ENERGY) * 0.2)
    np.testing.assert_allclose(high, np.array(ENERGY) * 0.5)
    low, high = interval(points(), "accuracy")
    assert low.tolist() == high.tolist() == [0.02] * 5
    assert interval(points(), "n_weights")[0].tolist() == [0.0] * 5


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"columns": ["accuracy"]}, "columns must be two or three, got 1"),
        ({"columns": ["model.hidden", "accuracy"]}, r"a direction.* got none for \['model.hidden'\]"),
        ({"columns": ["accuracy", "cost"]}, r"columns must be in the table, got \['cost'\]"),
        ({"labels": "gain"}, r"columns must be in the table, got \['gain'\]"),
        ({"task": "speed"}, "task must be one of texture, got 'speed'"),
    ],
)
def test_wrong_keys(keys, message):
    with pytest.raises(ValueError, match=message):
        gathered(points(), **keys)


def test_a_parameter_stands_beside_the_front_where_there_is_room():
    near = points(energy_uj=[50.0, 20.0, 21.0, 5.0, 50.1], accuracy=[0.95, 0.90, 0.85, 0.60, 0.951])
    dominated, best = draw(
        near.assign(**{"encoder.gain": [0.3, 1, 3, 10, "<b>"]}), labels="encoder.gain"
    ).data
    assert dominated.text is None and best.mode == "lines+markers+text"
    assert list(best.x) == [5.0, 20.0, 50.0, 50.1]
    assert list(best.text) == ["10", "1", "0.3", ""], "the last would cover the one before"


def test_drawing_shows_every_point_once_and_joins_the_front():
    figure = draw(points())
    dominated, best = figure.data
    assert list(dominated.x) == [21.0, 30.0]
    assert list(best.x) == [5.0, 20.0, 50.0]
    assert best.mode == "lines+markers"
    assert list(best.error_y.array) == [0.02] * 3
    assert figure.layout.xaxis.title.text == "energy (µJ)"
    assert figure.data[1].line.shape == "hv", "less energy is better: nothing lies left of a step"
    assert figure.layout.xaxis.type == figure.layout.yaxis.type == "linear"
    wide = points(energy_uj=[5000.0, 20.0, 21.0, 5.0, 30.0])
    turned = draw(wide, ["accuracy", "energy_uj"])
    assert turned.data[1].line.shape == "vh"
    assert turned.layout.yaxis.type == "log" and turned.layout.xaxis.type == "linear"


def test_intervals_of_a_crowded_front_are_thinned():
    n = 100
    many = pd.DataFrame({"accuracy": np.arange(n) / n, "accuracy_se": 0.01, "energy_uj": np.arange(n) + 1.0})
    figure = draw(many)
    bars = np.isfinite(np.array(figure.data[1].error_y.array, float))
    assert bars.sum() == 20 and len(bars) == n


def test_drawing_in_space_and_hover_is_escaped_and_short():
    frame = points(**{"model.kind": "<img src=x onerror=alert(1)>" + "a" * 500})
    before = frame.copy(deep=True)
    figure = draw(frame, ["energy_uj", "accuracy", "n_weights"])
    pd.testing.assert_frame_equal(frame, before)
    assert {trace.type for trace in figure.data} == {"scatter3d"}
    assert sum(len(trace.z) for trace in figure.data) == 5
    hover = gathered(frame).hover[0]
    assert "<img" not in hover and "&lt;img" in hover
    assert max(len(line) for line in hover.split("<br>")) < 100
