import numpy as np
import pytest

from dse.show.figures import NothingRecorded
from dse.show.figures.recognition import RecognitionFigure, curve
from tests.figure_data import study


@pytest.fixture
def curves():
    return (
        curve("knn", [100, 200, 300, 400], [0.3, 0.8, 0.7, 0.88]),
        curve("<snn>", [400, 200], [0.5, 0.2]),
        curve("unknown", [100], [np.nan]),
    )


def test_t_c_is_the_first_within_a_tenth_of_the_peak(curves):
    assert [(curve.name, curve.t_c_ms, curve.accuracy_at_t_c) for curve in curves[:2]] == [
        ("knn", 200.0, 0.8),  # 0.88 x 0.9 = 0.792; that accuracy falls again does not matter
        ("<snn>", 400.0, 0.5),
    ]
    assert curves[1].time_ms.tolist() == [200, 400] and curves[1].accuracy.tolist() == [0.2, 0.5]
    assert np.isnan([curves[2].t_c_ms, curves[2].accuracy_at_t_c]).all()


def test_drawing_marks_t_c_in_the_colour_of_its_curve(curves):
    line, mark, other, other_mark, single = RecognitionFigure().draw(curves).data
    assert list(line.x) == [100, 200, 300, 400] and list(line.y) == [0.3, 0.8, 0.7, 0.88]
    assert (mark.x[0], mark.y[0], mark.marker.symbol) == (200.0, 0.8, "circle-open")
    assert mark.marker.color == line.line.color != other.line.color == other_mark.marker.color
    assert "t_c 200 ms" in mark.hovertemplate
    assert (other.name, single.mode) == ("&lt;snn&gt;", "markers")
    curves = tuple(curve(str(i), [1, 2], [0.1, 0.2]) for i in range(14))
    lines = RecognitionFigure().draw(curves).data[::2]
    assert len({(line.line.color, line.line.dash) for line in lines}) == 14


def test_one_trial_is_the_mean_of_its_runs():
    runs = [
        {"decision_latency_ms": np.array([1.0, 2.0]), "accuracy": np.array(accuracy)}
        for accuracy in ([0.2, 0.4], [0.4, 0.8])
    ]
    (found,) = RecognitionFigure(3).gather(study(read_out=runs))
    assert found.accuracy.tolist() == pytest.approx([0.3, 0.6])
    assert not RecognitionFigure(3).draw((found,)).layout.showlegend
    for lacking in ([], [{name: values[:1] for name, values in runs[0].items()}]):
        with pytest.raises(NothingRecorded, match="must answer after several input lengths, got none"):
            RecognitionFigure(3).gather(study(read_out=lacking))
