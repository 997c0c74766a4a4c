import numpy as np
import pandas as pd
import pytest

from dse.show.figures import NothingRecorded
from dse.show.figures.precision import PrecisionFigure
from tests.figure_data import study

FIGURE = PrecisionFigure(trial=7)
NAN = np.nan


def gathered(points):
    return FIGURE.gather(study(points))


@pytest.fixture
def points():
    return pd.DataFrame(
        {
            "trial": 7,
            "hardware": "chip",
            "weight_bits": [8, 4, 8, 2, 4, 8],
            "pruned_after": [0.0, 0.0, 0.5, 0.0, 0.0, 0.0],
            "phi": [NAN, NAN, NAN, NAN, 2.0, NAN],
            "read_out_ms": [NAN, NAN, NAN, NAN, NAN, 40.0],
            "accuracy": [0.9, 0.8, 0.85, 0.5, 0.1, 0.1],
            "accuracy_se": [0.01, 0.02, 0.03, 0.04, 0.5, 0.5],
            "memory_bytes": [800.0, 400.0, 400.0, 200.0, 400.0, 800.0],
            "energy_uj": [3.0, 2.5, 2.0, 1.0, 0.1, 0.1],
        }
    )


def test_the_answers_at_the_end_by_bits_and_share(points):
    found = gathered(points)
    assert found.weight_bits.tolist() == [2, 4, 8] and found.pruned.tolist() == [0.0, 0.5]
    np.testing.assert_array_equal(found.accuracy, [[0.5, 0.8, 0.9], [NAN, NAN, 0.85]])
    np.testing.assert_array_equal(found.costs["memory_bytes"], [[200, 400, 800], [NAN, NAN, 400]])
    assert found.accuracy_se[0].tolist() == [0.04, 0.02, 0.01]
    assert list(found.costs) == ["weight_bits", "memory_bytes", "energy_uj"]
    found = gathered(points.drop(columns=["hardware", "energy_uj"]))
    assert list(found.costs) == ["weight_bits", "memory_bytes"]
    assert len(FIGURE.draw(found).data) == 4


def test_drawing_has_a_panel_for_each_cost_and_a_line_for_each_share(points):
    figure = FIGURE.draw(gathered(points))
    traces = [(t.name, list(t.x), list(t.y), list(t.error_y.array), t.showlegend) for t in figure.data]
    assert traces == [
        ("all weights", [2, 4, 8], [0.5, 0.8, 0.9], [0.04, 0.02, 0.01], True),
        ("50% removed", [8], [0.85], [0.03], True),
        ("all weights", [200, 400, 800], [0.5, 0.8, 0.9], [0.04, 0.02, 0.01], False),
        ("50% removed", [400], [0.85], [0.03], False),
        ("all weights", [1, 2.5, 3], [0.5, 0.8, 0.9], [0.04, 0.02, 0.01], False),
        ("50% removed", [2], [0.85], [0.03], False),
    ]
    axes = figure.layout
    titles = [axes.xaxis.title.text, axes.xaxis2.title.text, axes.xaxis3.title.text, axes.yaxis.title.text]
    assert titles[0] == "bits per weight" and titles[2:] == ["energy (µJ)", "accuracy"]
    assert titles[1].startswith("memory")


def test_what_has_no_answer_at_the_end_cannot_be_shown(points):
    with pytest.raises(NothingRecorded, match="at least one decision at the end of the window, got none"):
        gathered(points.iloc[4:])
