import numpy as np
import pytest

from dse.figures.confusion import draw_confusion, gather_confusion


def test_rates_are_per_true_class():
    confusion = gather_confusion(np.array([[3, 1], [0, 0]]), ["a", "b"])
    assert confusion.rates.tolist() == [[0.75, 0.25], [0.0, 0.0]]


def test_drawing_keeps_classes_of_equal_name_apart():
    figure = draw_confusion(gather_confusion(np.eye(3, dtype=int), ["a", "a", "<b>"]))
    assert figure.data[0].z.shape == (3, 3)
    assert list(figure.layout.xaxis.ticktext) == ["a", "a", "&lt;b&gt;"]
    assert figure.layout.yaxis.autorange == "reversed"


@pytest.mark.parametrize(
    ("counts", "message"),
    [(np.zeros((2, 3)), r"counts must be \(2, 2\) as classes, got \(2, 3\)"), (-np.eye(2), ">= 0, got -1")],
)
def test_wrong_counts(counts, message):
    with pytest.raises(ValueError, match=message):
        gather_confusion(counts, ["a", "b"])
