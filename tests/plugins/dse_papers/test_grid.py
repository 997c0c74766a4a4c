import numpy as np
import pandas as pd
import pytest

from dse_papers.figures.grid import MAX_VALUES, GridFigure, gather_grid

EVIL = "<img src=x onerror=alert(1)>"


def table(**more):
    """Return three hidden sizes by two rates, with a second trial of (50, 0.2) and none of (100, 0.8)."""
    return pd.DataFrame(
        {
            "model.hidden": [100, 50, 50, 50, 8, 8],
            "model.true_rate": [0.2, 0.8, 0.2, 0.2, 0.2, 0.8],
            "accuracy": [0.9, 0.7, 0.5, 0.7, 0.1, 0.3],
        }
    ).assign(**more)


def test_cells_hold_the_mean_over_what_else_differs():
    grid = gather_grid(table(), "model.hidden", "model.true_rate")
    assert grid.x_labels == ("8", "50", "100")
    assert grid.y_labels == ("0.2", "0.8")
    np.testing.assert_allclose(grid.mean, [[0.1, 0.6, 0.9], [0.3, 0.7, np.nan]])
    assert grid.n.tolist() == [[1, 2, 1], [1, 1, 0]]
    assert grid.n_left_out == 0


def test_rows_that_miss_something_are_counted():
    frame = table(
        accuracy=[np.nan, 0.7, np.inf, 0.7, 0.1, 0.3], **{"model.true_rate": [0.2, 0.8, 0.2, 0.2, None, 0.8]}
    )
    grid = gather_grid(frame, "model.hidden", "model.true_rate")
    assert grid.n_left_out == 3
    assert grid.x_labels == ("8", "50")
    np.testing.assert_allclose(grid.mean, [[np.nan, 0.7], [0.3, 0.7]])


def test_infinite_settings_have_no_cell():
    grid = gather_grid(
        table(**{"model.hidden": [100, np.inf, 50, 50, 8, 8]}), "model.hidden", "model.true_rate"
    )
    assert grid.x_labels == ("8", "50", "100")
    assert grid.n_left_out == 1


def test_words_keep_the_order_of_the_table_and_claims_are_words():
    grid = gather_grid(
        table(**{"model.kind": ["snn", "elm", "snn", "knn", "elm", "elm"], "recurrent": [True, False] * 3}),
        "model.kind",
        "recurrent",
    )
    assert grid.x_labels == ("snn", "elm", "knn")
    assert grid.y_labels == ("True", "False")
    assert grid.n.tolist() == [[2, 1, 0], [0, 2, 1]]


def test_settings_that_differ_little_have_cells_of_their_own():
    frame = pd.DataFrame({"a": [0.12341, 0.12342, 1e6], "b": [1, 1, 1], "accuracy": [0.1, 0.2, 0.3]})
    assert gather_grid(frame, "a", "b").x_labels == ("0.12341", "0.12342", "1000000")


def test_many_numbers_are_binned_and_none_is_lost():
    n = MAX_VALUES + 1
    even = np.linspace(0, 12, 121)
    frame = pd.DataFrame({"a": even, "b": 1, "accuracy": even})
    grid = gather_grid(frame, "a", "b")
    assert grid.x_labels[:2] == ("0–1", "1–2")
    assert grid.n.tolist() == [[10] * 11 + [11]]
    np.testing.assert_allclose(grid.mean[0, 0], np.mean(even[:10]))
    wide = np.geomspace(1, 4096, n)  # 12 octaves
    assert gather_grid(pd.DataFrame({"a": wide, "b": 1, "accuracy": 1}), "a", "b").x_labels[:2] == (
        "1–2",
        "2–4",
    )


@pytest.mark.parametrize("frame", [table().iloc[:0], table(accuracy=np.nan), table().iloc[:1]])
def test_empty_and_one_row(frame):
    grid = gather_grid(frame, "model.hidden", "model.true_rate")
    n = int(np.isfinite(frame["accuracy"]).sum())
    assert grid.mean.shape == (n, n)
    assert grid.n_left_out == len(frame) - n
    assert len(GridFigure(x="", y="").draw(grid).data[0].z) == n


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        (("model.hidden", "cost", "accuracy"), r"columns must be in the table, got \['cost'\]"),
        (("model.hidden", "model.hidden", "accuracy"), "must be three columns"),
        (("model.hidden", "accuracy", "accuracy"), "must be three columns"),
    ],
)
def test_wrong_columns(columns, message):
    with pytest.raises(ValueError, match=message):
        gather_grid(table(), *columns)


def test_drawing_leaves_empty_cells_blank_and_prints_the_others():
    figure = GridFigure(x="", y="").draw(gather_grid(table(), "model.hidden", "model.true_rate"))
    (heat,) = figure.data
    assert heat.z[1][2] is None
    assert list(heat.text[1]) == ["0.3", "0.7", ""]
    assert heat.texttemplate == "%{text}"
    assert list(heat.customdata[0][1]) == [2, "50", "0.2"]
    assert list(figure.layout.xaxis.ticktext) == ["8", "50", "100"]
    assert figure.layout.xaxis.title.text == "model.hidden"
    assert heat.colorbar.title.text == "mean accuracy"


def test_small_cells_have_no_text_and_ticks_are_thinned():
    frame = pd.DataFrame({"a": range(20), "b": 1, "accuracy": 0.5})
    figure = GridFigure(x="", y="").draw(gather_grid(frame, "a", "b"))
    assert figure.data[0].texttemplate is None
    assert list(figure.layout.xaxis.ticktext) == [str(n) for n in range(0, 20, 2)]


def test_hostile_names_are_escaped_and_short():
    frame = pd.DataFrame({EVIL: [EVIL, "x" * 500], "b": [1, 2], "a_uj" + EVIL: [0.1, 0.2]})
    figure = GridFigure(x="", y="").draw(gather_grid(frame, EVIL, "b", "a_uj" + EVIL))
    drawn = figure.to_json()
    assert "<img" not in drawn.replace("\\u003c", "<")
    assert max(map(len, figure.layout.xaxis.ticktext)) < 30
