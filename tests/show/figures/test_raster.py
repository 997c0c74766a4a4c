import numpy as np
import pytest

from dse.measure.decision import decide
from dse.show.figures.raster import RecordingFigure, gather_recording

# Class 1 leads from its second spike on; two spikes of class 0 come first.
OUTPUT = np.array([[0, 0], [1, 0], [1, 0], [0, 1], [0, 1], [0, 1]], np.uint8)
LAYERS = np.array([[9, 0], [4, 1], [0, 1], [0, 1], [2, 1], [0, 1]])
CLASSES = ("felt", "<b>silk</b>")


def gathered(**more):
    return gather_recording(OUTPUT, LAYERS, 5.0, CLASSES, **more)


def test_numbers_by_hand():
    found = gathered(true=1)
    assert found.spikes.tolist() == [[1, 0], [2, 0], [3, 1], [4, 1], [5, 1]]
    assert np.isnan(found.confidence[0])
    assert found.confidence[1:].tolist() == pytest.approx([1, 1, 2 / 3, 1 / 2, 3 / 5])
    assert found.leading.tolist() == [0, 0, 0, 0, 0, 1]
    assert found.time_ms.tolist() == [5, 10, 15, 20, 25, 30]
    assert (found.answer, found.decision_ms, found.decided) == (1, 30.0, False)
    assert (found.phi, found.theta) == (None, None)


@pytest.mark.parametrize("setting", [(0, 0.9), (1, 0.9), (2, 0.6), (4, 0.7), (0, 0.0)])
def test_the_decision_is_that_of_the_decision_maker(setting):
    found = gathered(setting=setting)
    by_rule = decide(OUTPUT[None], *setting)
    assert (found.answer, found.decided) == (by_rule.label[0], by_rule.decided[0])
    assert found.decision_ms == (by_rule.step[0] + 1) * 5.0
    assert (found.phi, found.theta) == setting


def test_a_recording_without_a_spike():
    found = gather_recording(np.zeros((4, 2), np.uint8), np.zeros((4, 2), int), 1.0, CLASSES, 0, (0, 0.5))
    assert np.isnan(found.confidence).all()
    assert (found.answer, found.decision_ms, found.decided) == (0, 4.0, False)
    figure = RecordingFigure().draw(found)
    assert list(figure.data[2].y) == [None] * 4
    assert (figure.data[3].z == 0).all()


def test_drawing():
    figure = RecordingFigure().draw(gathered(true=1, setting=(1, 0.6)))
    meant, others, share, layers = figure.data
    assert (list(meant.x), list(meant.y)) == ([20, 25, 30], [1, 1, 1])
    assert (list(others.x), list(others.y)) == ([10, 15], [0, 0])
    assert (share.x0, share.dx, share.y[3]) == (5.0, 5.0, 0.667)
    assert layers.customdata.tolist() == LAYERS.T.tolist()
    assert layers.z.tolist() == [[100, 44, 0, 0, 22, 0], [0, 100, 100, 100, 100, 100]]
    lines = {shape.name: shape for shape in figure.layout.shapes}
    assert (lines["decision"].x0, lines["decision"].x1, lines["theta"].y0) == (15.0, 15.0, 0.6)
    assert lines["decision"].line.dash == "solid"
    assert figure.layout.xaxis.title.text == "time (ms)"
    assert list(figure.layout.yaxis3.ticktext) == ["input ≤ 9", "output ≤ 1"]


def test_an_undecided_recording_has_no_theta_and_names_cannot_be_markup():
    figure = RecordingFigure().draw(gathered())
    [line] = figure.layout.shapes
    assert (line.name, line.line.dash) == ("decision", "dot")
    assert [trace.name for trace in figure.data][:1] == ["output spike"]
    assert "&lt;b&gt;silk" in figure.layout.yaxis.ticktext[1]
    assert "<b>" not in figure.to_json().replace("\\u003c", "<")


def test_names_of_many_classes_do_not_cover_each_other():
    names = [f"a long name of class {k}" for k in range(100)]
    found = gather_recording(np.ones((3, 100), np.uint8), np.ones((3, 2), int), 1.0, names)
    axis = RecordingFigure().draw(found).layout.yaxis
    assert len(axis.ticktext) == len(axis.tickvals) == 12
    assert max(map(len, axis.ticktext)) == 12


@pytest.mark.parametrize(
    ("output", "layers", "more", "message"),
    [
        (OUTPUT[:, :1], LAYERS, {}, r"output must be \(T, 2\) as classes, got \(6, 1\)"),
        (OUTPUT[:0], LAYERS[:0], {}, "output must be"),
        (OUTPUT, LAYERS[1:], {}, r"layers must be \(6, layer\) as output, got \(5, 2\)"),
        (OUTPUT, LAYERS, {"true": 2}, r"true must be in 0\.\.1, got 2"),
        (OUTPUT, LAYERS, {"setting": (0, 1.5)}, r"theta must be in \[0, 1\], got 1.5"),
    ],
)
def test_what_does_not_belong_together(output, layers, more, message):
    with pytest.raises(ValueError, match=message):
        gather_recording(output, layers, 1.0, CLASSES, **more)
