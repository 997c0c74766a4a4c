import numpy as np
import pytest

from dse.show.figures.learning import LearningFigure
from tests.figure_data import study

FIGURE = LearningFigure(trial=0)


def gathered(*histories):
    return FIGURE.gather(study(history=list(histories)))


LONG = {
    "loss": np.array([3.0, 2.0, 1.0]),
    "accuracy_train": np.array([0.2, 0.5, 0.9]),
    "members": np.array(4),
}
SHORT = {"loss": np.array([4.0, 2.5])}


def test_repeats_of_different_lengths():
    found = gathered(LONG, SHORT)
    assert list(found.curves) == ["loss", "accuracy_train"]
    assert [curve.tolist() for curve in found.curves["loss"]] == [[3, 2, 1], [4, 2.5]]
    assert [curve.tolist() for curve in found.curves["accuracy_train"]] == [[0.2, 0.5, 0.9], []]


def test_what_has_no_epochs_has_no_curve():
    assert list(gathered(LONG | {"loss": np.array([1.0])}).curves) == ["accuracy_train"]
    for histories in ([{}], [{"accuracy_train": np.array([0.9])}], [{"members": np.array(4)}]):
        with pytest.raises(
            ValueError, match="trial 0 must have two epochs of one of loss, accuracy_train, gradient_norm"
        ):
            gathered(*histories)


def test_drawing():
    gradient = {"gradient_norm": np.array([1.0, 0.1, np.inf])}
    figure = FIGURE.draw(gathered(LONG | gradient, SHORT))
    lines = {(trace.yaxis, trace.name): trace for trace in figure.data}
    assert list(lines["y", "repeat 1"].x) == [1, 2]
    assert list(lines["y2", "repeat 0"].y) == pytest.approx([0.2, 0.5, 0.9])
    assert [trace.showlegend for trace in figure.data].count(True) == 2
    layout = figure.layout
    assert layout.yaxis3.type == "log"
    assert (layout.yaxis.title.text, layout.xaxis.title.text, layout.xaxis.anchor) == ("loss", "epoch", "y3")
    # Panels from top to bottom, apart from each other.
    ends = [end for axis in (layout.yaxis3, layout.yaxis2, layout.yaxis) for end in axis.domain]
    assert ends == sorted(set(ends))
    assert not any(trace.showlegend for trace in FIGURE.draw(gathered(SHORT)).data), "a single repeat"
    [line] = FIGURE.draw(gathered({"loss": np.arange(1000.0)})).data
    assert len(line.x) <= 120 and list(line.x[:2]) == [1, 10] and list(line.y[:2]) == [0, 9]
