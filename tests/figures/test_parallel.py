import numpy as np
import pandas as pd
import pytest

from dse.figures import parallel
from dse.figures.parallel import ParallelFigure
from tests.figure_data import study
from tests.page_data import ACCURACY, ENERGY, OBJECTIVES, ON_FRONT, points

COLUMNS = ["model.hidden", "accuracy", "energy_uj"]
DRAW = ParallelFigure().draw


def gathered(frame, columns=COLUMNS, objectives=OBJECTIVES):
    return ParallelFigure(tuple(columns)).gather(study(frame, objectives))


def test_lines_are_the_points_and_the_front_is_over_all_objectives():
    found = gathered(points())
    assert found.columns == tuple(COLUMNS)
    assert found.values[:, 1].tolist() == ACCURACY
    assert found.values[:, 2].tolist() == ENERGY
    assert found.on_front.tolist() == ON_FRONT
    assert found.categories == (None, None, None)
    assert (found.n_incomplete, found.n_left_out) == (0, 0)


def test_tasks_have_fronts_of_their_own_and_misfits_and_leaks_none():
    frame = pd.concat([points(hardware="a"), points(hardware="a", task="speed")], ignore_index=True).assign(
        fits=True
    )
    frame.loc[0, "fits"] = False
    found = gathered(frame)
    assert found.on_front.reshape(2, 5).tolist() == [[False, True, True, True, False], ON_FRONT]
    seen = points(transductive=[False, True, False, False, False])
    assert gathered(seen).on_front.tolist() == [True, False, True, True, True]
    assert gathered(points(accuracy=0.5, energy_uj=1.0, n_weights=3)).on_front.all(), "equal points"


def test_words_are_categories_and_so_is_their_absence():
    frame = points(
        **{"model.kind": ["snn", None, "elm", "snn", "elm"], "fine": [True, False, True, True, True]}
    )
    found = gathered(frame, ["model.kind", "fine"])
    assert found.categories == (("snn", "–", "elm"), ("yes", "no"))
    assert found.values.tolist() == [[0, 0], [1, 1], [2, 0], [0, 0], [2, 0]]
    claims = points(fine=pd.array([True, None, False, True, True], "boolean"))
    assert gathered(claims, ["fine", "accuracy"]).categories[0] == ("yes", "–", "no")


def test_rows_without_a_number_are_counted():
    found = gathered(points(energy_uj=[50, np.nan, 21, np.inf, 30]))
    assert found.n_incomplete + len(found.values) == 5
    assert found.values[:, 1].tolist() == [0.95, 0.85, 0.88]
    assert found.on_front.all()  # what beats the last row has no energy


def test_the_front_is_whole_and_the_others_an_even_sample(monkeypatch):
    monkeypatch.setattr(parallel, "MAX_LINES", 10)
    n = 101
    many = pd.DataFrame({"a": range(n), "accuracy": 0.1, "energy_uj": 9.0})
    best = pd.DataFrame({"a": [500.0, 501.0], "accuracy": [0.9, 0.8], "energy_uj": [2.0, 1.0]})
    found = gathered(pd.concat([many, best]), ["a", "accuracy"], {"accuracy": "max", "energy_uj": "min"})
    assert found.on_front.tolist() == [False] * 8 + [True] * 2
    assert found.values[:8, 0].tolist() == [round(k * 100 / 7) for k in range(8)]
    assert found.n_left_out == n - 8
    monkeypatch.setattr(parallel, "MAX_LINES", 1)
    front = gathered(pd.concat([many, best]), ["a", "accuracy"], {"accuracy": "max", "energy_uj": "min"})
    assert front.on_front.tolist() == [True, True]


@pytest.mark.parametrize("n", [0, 1])
def test_empty_and_one_row(n):
    found = gathered(points().iloc[:n])
    assert found.values.shape == (n, 3)
    others, front = DRAW(found).data
    assert np.sum(np.isfinite(others.y)) == 0 and np.sum(np.isfinite(front.y)) == 3 * n


@pytest.mark.parametrize(
    ("columns", "objectives", "message"),
    [
        (["accuracy"], OBJECTIVES, "at least two distinct columns"),
        (["accuracy", "accuracy"], OBJECTIVES, "at least two distinct columns"),
        (["accuracy", "cost"], OBJECTIVES, r"must be in the table, got \['cost'\]"),
        (COLUMNS, {"cost": "min"}, "objectives must hold at least one column"),
    ],
)
def test_wrong_columns(columns, objectives, message):
    with pytest.raises(ValueError, match=message):
        gathered(points().iloc[:0], columns, objectives)


def test_drawing_colours_the_front_and_uses_logarithms_over_decades():
    figure = DRAW(gathered(points(energy_uj=[1.0, 20.0, 300.0, 4000.0, 50.0])))
    others, front = (np.reshape(trace.y, (-1, 4)) for trace in figure.data)
    assert (len(others), len(front)) == (2, 3)
    np.testing.assert_allclose(front[:, 1], (np.array(ACCURACY[:3]) - 0.6) / 0.35)
    np.testing.assert_allclose(front[:, 2], np.log10([1.0, 20.0, 300.0]) / np.log10(4000))
    assert list(figure.layout.xaxis.ticktext) == ["model.hidden", "accuracy", "energy (µJ)"]
    energy = [note.text for note in figure.layout.annotations if note.x == 2]
    assert energy == ["1", "10", "100", "1\u202f000"]


def test_a_parameter_that_some_families_lack_leaves_their_lines_below_its_axis():
    found = gathered(points(**{"model.hidden": [100, 50, np.nan, 25, 75]}))
    assert found.n_incomplete == 0
    figure = DRAW(found)
    assert np.reshape(figure.data[1].y, (-1, 4))[2, 0] < 0
    assert [note.text for note in figure.layout.annotations if note.x == 0][-1] == "–"


def test_hostile_names_are_escaped_where_plotly_reads_marks_and_short():
    evil = "<img src=x onerror=alert(1)>"
    frame = points(**{evil: [evil, "x" * 500, "%{x} 🦔", "", "y"]})
    layout = DRAW(gathered(frame, [evil, "accuracy"])).layout
    assert list(layout.xaxis.ticktext) == ["&lt;img src=x onerror=aler…", "accuracy"]
    words = [note.text for note in layout.annotations if note.x == 0]
    assert words[0] == "&lt;img src=x onerror=aler…"
    assert max(map(len, words[1:])) <= 24
