import numpy as np
import pytest

from dse.base import registry
from dse.testing.small import SmallStudy
from dse_papers.figures.histograms import draw_histograms, gather_histograms


def learnt(scale=1.0):
    """Two input lengths, three labelled histograms over two prototypes."""
    whole = [[0.25, 0.75], [0.75, 0.25], [0.0, 1.0]]
    signatures = np.array([[[9.0, 9.0]] * 3, whole], np.float32) * scale
    return {"signatures": signatures, "signature_class": np.array([1, 1, 0])}


def test_the_mean_of_a_class_after_the_whole_window():
    found = gather_histograms(learnt(), ["a", "b"])
    assert found.activity.tolist() == [[0, 1], [0.5, 0.5]]
    assert found.normalised


def test_counts_of_some_classes():
    found = gather_histograms(learnt(8), ["a", "b"], ["b"])
    assert found.classes == ("b",) and found.activity.tolist() == [[4, 4]]
    assert not found.normalised


def test_a_panel_per_class():
    figure = draw_histograms(gather_histograms(learnt(8), ["a", "<b>"]))
    assert [list(bars.y) for bars in figure.data] == [[0, 8], [4, 4]]
    assert [note.text for note in figure.layout.annotations] == [
        *("a", "&lt;b&gt;"),
        *("prototype of the last layer", "events per recording"),
    ]


def test_what_it_refuses():
    with pytest.raises(ValueError, match="class 'c' must have a labelled histogram, got none"):
        gather_histograms(learnt(), ["a", "b", "c"])
    with pytest.raises(ValueError, match="classes must be of a, b, got 'x'"):
        gather_histograms(learnt(), ["a", "b"], ["x"])


def test_a_study_without_histograms():
    figure = registry.known("figures")["histograms"]
    with pytest.raises(ValueError, match=r"trial 1 recorded no 'own/signatures' in weights"):
        figure(trial=1).gather(SmallStudy())
