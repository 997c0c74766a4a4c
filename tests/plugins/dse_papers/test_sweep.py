import numpy as np
import pandas as pd
import pytest

from dse.testing.small import SmallStudy
from dse_papers.figures.sweep import SweepFigure
from tests.figure_data import study


def gathered(points, x, columns, by=""):
    return SweepFigure(x, tuple(columns), by=by).gather(study(points))


def points():
    return pd.DataFrame(
        {
            "trial": [0, 1, 2, 3, 4, 5],
            "family": ["elm", "elm", "elm", "elm", "<knn>", "elm"],
            "window_ms": [200.0, 50.0, 200.0, 200.0, 100.0, np.nan],
            "accuracy": [0.6, 0.5, 0.8, 0.8, 0.7, 0.9],
            "accuracy_se": [0.1, 0.2, 0.3, 0.4, 0.5, 0.6],
            "itr_bits_per_s": [3.0, 2.0, np.nan, 5.0, 1.0, 9.0],
        }
    )


def test_the_best_design_at_every_value():
    found = gathered(points(), "window_ms", ["accuracy", "itr_bits_per_s"])
    knn, elm = found.lines
    assert (elm.name, elm.x.tolist()) == ("elm", [50, 200])
    assert elm.trial.tolist() == [1, 2], "the first of equal ones"
    assert elm.values["accuracy"].tolist() == [0.5, 0.8]
    assert elm.low["accuracy"].tolist() == elm.high["accuracy"].tolist() == [0.2, 0.3]
    assert elm.values["itr_bits_per_s"][0] == 2 and np.isnan(elm.values["itr_bits_per_s"][1])
    assert (knn.name, knn.x.tolist()) == ("<knn>", [100])
    assert found.n_left_out == 1


def test_a_panel_per_column():
    figure = SweepFigure("").draw(gathered(points(), "window_ms", ["accuracy", "itr_bits_per_s"]))
    assert [trace.name for trace in figure.data] == ["&lt;knn&gt;", "elm"] * 2
    assert (figure.layout.yaxis.title.text, figure.layout.yaxis2.title.text) == ("accuracy", "itr (bit/s)")
    assert figure.layout.xaxis2.title.text == "window (ms)"
    assert [trace.showlegend for trace in figure.data] == [True, True, False, False]
    [line] = SweepFigure("").draw(gathered(points()[:3], "window_ms", ["accuracy"])).data
    assert not line.showlegend


def test_a_line_per_value_of_another_column():
    frame = points().assign(gain=[1.0, 1.0, 2.0, 2.0, 2.0, 2.0])
    found = gathered(frame, "window_ms", ["accuracy"], "gain")
    assert [line.name for line in found.lines] == ["<knn> gain 2", "elm gain 1", "elm gain 2"]
    assert [line.trial.tolist() for line in found.lines] == [[4], [1, 0], [2]]


def test_columns_alike_are_one_parameter():
    frame = pd.DataFrame(
        {
            "trial": [0, 1, 2],
            "family": ["knn", "mlp", "mlp"],
            "model.knn.window_ms": [100.0, np.nan, np.nan],
            "model.mlp.window_ms": [np.nan, 50.0, 200.0],
            "accuracy": [0.9, 0.7, 0.8],
        }
    )
    knn, mlp = gathered(frame, "model.*.window_ms", ["accuracy"]).lines
    assert (knn.x.tolist(), mlp.x.tolist()) == ([100], [50, 200])
    figure = SweepFigure("").draw(gathered(frame, "model.*.window_ms", ["accuracy"]))
    assert figure.layout.xaxis.title.text == "model.*.window (ms)"
    with pytest.raises(
        ValueError, match=r"a row must have a number in one of model.knn.window_ms, model.mlp"
    ):
        gathered(frame.assign(**{"model.x.window_ms": 1.0}), "model.*.window_ms", ["accuracy"])
    with pytest.raises(ValueError, match=r"a row must have numbers of model.*.tau and accuracy, got none"):
        gathered(frame, "model.*.tau", ["accuracy"])


def test_of_one_family():
    found = SweepFigure(x="model.hidden", family="snn", task="texture").gather(SmallStudy())
    assert [line.x.tolist() for line in found.lines] == [[4, 6, 9]]
    with pytest.raises(ValueError, match="family must be one of snn, got 'elm'"):
        SweepFigure(x="model.hidden", family="elm").gather(SmallStudy())


@pytest.mark.parametrize(
    ("frame", "keys", "message"),
    [
        (points(), ("gain", ["accuracy"]), r"columns must be in the table, got \['gain'\]"),
        (points(), ("trial", ["accuracy"] * 2), r"none the x 'trial', got \['accuracy', 'accuracy'\]"),
        (points(), ("trial", []), r"got \[\]"),
        (points()[5:], ("window_ms", ["accuracy"]), "must have numbers of window_ms and accuracy, got none"),
    ],
)
def test_what_it_refuses(frame, keys, message):
    with pytest.raises(ValueError, match=message):
        gathered(frame, *keys)
