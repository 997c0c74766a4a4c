import numpy as np
import pytest

from dse.figures.recognition import draw_recognition, gather_recognition


@pytest.fixture
def curves():
    return gather_recognition(
        {
            "knn": ([100, 200, 300, 400], [0.3, 0.8, 0.7, 0.88]),
            "<snn>": ([400, 200], [0.5, 0.2]),
            "unknown": ([100], [np.nan]),
        }
    )


def test_t_c_is_the_first_within_a_tenth_of_the_peak(curves):
    assert [(curve.name, curve.t_c_ms, curve.accuracy_at_t_c) for curve in curves[:2]] == [
        ("knn", 200.0, 0.8),  # 0.88 x 0.9 = 0.792; that accuracy falls again does not matter
        ("<snn>", 400.0, 0.5),
    ]
    assert curves[1].time_ms.tolist() == [200, 400] and curves[1].accuracy.tolist() == [0.2, 0.5]
    assert np.isnan([curves[2].t_c_ms, curves[2].accuracy_at_t_c]).all()


def test_drawing_marks_t_c_in_the_colour_of_its_curve(curves):
    line, mark, other, other_mark, single = draw_recognition(curves).data
    assert list(line.x) == [100, 200, 300, 400] and list(line.y) == [0.3, 0.8, 0.7, 0.88]
    assert (mark.x[0], mark.y[0], mark.marker.symbol) == (200.0, 0.8, "circle-open")
    assert mark.marker.color == line.line.color != other.line.color == other_mark.marker.color
    assert "t_c 200 ms" in mark.hovertemplate
    assert (other.name, single.mode) == ("&lt;snn&gt;", "markers")


def test_more_curves_than_colours_are_told_apart():
    one = [1, 2], [0.1, 0.2]
    lines = draw_recognition(gather_recognition({str(i): one for i in range(14)})).data[::2]
    assert len({(line.line.color, line.line.dash) for line in lines}) == 14


@pytest.mark.parametrize(("columns", "got"), [(([], []), "0 and 0"), (([1, 2], [0.5]), "2 and 1")])
def test_columns_that_do_not_fit(columns, got):
    with pytest.raises(
        ValueError, match=f"'a' must have one or more input lengths and an accuracy for each, got {got}"
    ):
        gather_recognition({"a": columns})
