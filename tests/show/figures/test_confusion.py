import numpy as np
import pytest

from dse.show.figures.confusion import ConfusionFigure
from tests.figure_data import study

FIGURE = ConfusionFigure(trial=0)


def gathered(classes, *counts):
    return FIGURE.gather(study(classes=classes, confusion=[{"validation": np.array(x)} for x in counts]))


def test_rates_are_per_true_class():
    confusion = gathered(["a", "b"], [[2, 1], [0, 0]], [[1, 0], [0, 0]])
    assert confusion.rates.tolist() == [[0.75, 0.25], [0.0, 0.0]]


def test_drawing_keeps_classes_of_equal_name_apart():
    figure = FIGURE.draw(gathered(["a", "a", "<b>"], np.eye(3, dtype=int)))
    assert figure.data[0].z.shape == (3, 3)
    assert list(figure.layout.xaxis.ticktext) == ["a", "a", "&lt;b&gt;"]
    assert figure.layout.yaxis.autorange == "reversed"


@pytest.mark.parametrize("counts", [np.zeros((2, 3), int), -np.eye(2, dtype=int)])
def test_wrong_counts(counts):
    with pytest.raises(ValueError, match="trial 0 must have counts >= 0 of 2 classes"):
        gathered(["a", "b"], counts)
