from dataclasses import replace

import numpy as np
import pytest

from dse.base.records import Dataset, Head
from dse.testing.small import spikes_of
from dse_papers.figures.psth import PsthFigure, gather_psth
from tests.saved_data import in_a_row

NONE = np.zeros(0, np.int64)


def dataset(start=1):
    """Four recordings of six steps of 10 ms and two channels; the window leaves the first step out."""
    fired = np.zeros((4, 6, 2), bool)
    fired[0, [0, 1, 2, 5]] = True  # both channels
    fired[1, [1, 3], 0] = True
    fired[2, 4, 1] = True
    fired[3] = True  # in no part of the split
    begin = np.full(4, start, np.int32)
    return Dataset(
        spikes=spikes_of(fired, 10.0),
        target=np.array([0, 0, 1, -1]),
        classes=("a", "<b>"),
        start=begin,
        start_low=begin,
        start_high=begin,
        n_steps=6 - start,
        train=np.array([0]),
        validation=np.array([2]),
        test=np.array([1]),
        positions=in_a_row(2),
    )


def test_rates_by_hand():
    found = gather_psth(dataset(), bin_ms=20.0)
    assert found.edges_ms.tolist() == [0, 20, 40, 50], "the last window of time is shorter"
    assert found.n_trials.tolist() == [2, 1]
    # Spikes of 'a' from step 1 on: 4 + 1, 0 + 1, 2 + 0, in 20, 20 and 10 ms of two recordings.
    assert found.rate_hz == pytest.approx(np.array([[125.0, 25.0, 100.0], [0.0, 50.0, 0.0]]))


def test_a_window_is_at_least_one_step():
    found = gather_psth(dataset(), bin_ms=1.0, classes=["<b>"])
    assert found.classes == ("<b>",)
    assert found.rate_hz.tolist() == [[0, 0, 0, 100.0, 0]]


def test_the_classes_of_a_head():
    heads = (Head("texture", ("x",), np.array([0, 0])), Head("speed", ("s", "f"), np.array([1, 0])))
    joint = replace(dataset(), heads=heads)
    assert gather_psth(joint, 50.0).rate_hz.tolist() == [[pytest.approx(9 / 3 / 0.05)]]
    found = gather_psth(joint, 50.0, task="speed")
    assert found.classes == ("s", "f") and found.n_trials.tolist() == [1, 2]
    with pytest.raises(ValueError, match="task must be one of texture, speed, got 'force'"):
        gather_psth(joint, task="force")


def test_silence_draws_an_empty_scale():
    quiet = replace(dataset(), spikes=spikes_of(np.zeros((4, 6, 2), bool), 10.0))
    figure = PsthFigure().draw(gather_psth(quiet, 20.0))
    assert list(figure.layout.yaxis.range) == [0, 1]


def test_a_panel_per_class_on_one_scale():
    figure = PsthFigure().draw(gather_psth(dataset(), 20.0))
    assert [note.text for note in figure.layout.annotations[:2]] == ["a (n = 2)", "&lt;b&gt; (n = 1)"]
    assert list(figure.data[0].y) == pytest.approx([125.0, 25.0, 100.0, 100.0])
    assert figure.layout.yaxis.range[1] == figure.layout.yaxis2.range[1] == pytest.approx(1.05 * 125)


def test_what_it_refuses():
    with pytest.raises(ValueError, match="classes must be of a, <b>, got 'c'"):
        gather_psth(dataset(), classes=["c"])
    with pytest.raises(ValueError, match="task must be absent, because the target is not joint, got 'x'"):
        gather_psth(dataset(), task="x")
    with pytest.raises(ValueError, match="class '<b>' must have at least one recording, got none"):
        gather_psth(replace(dataset(), validation=NONE))
