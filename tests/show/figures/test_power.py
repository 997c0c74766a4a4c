import numpy as np
import pandas as pd
import pytest

from dse.show.figures import NothingRecorded
from dse.show.figures.power import PowerFigure
from tests.figure_data import study

FIGURE = PowerFigure(trial=0)


def points():
    """The printed figures of three platforms, and a chip whose power nobody knows."""
    return pd.DataFrame(
        {
            "trial": 0,
            "hardware": ["CPU", "GPU", "<Loihi 2>", "other", "GPU"],
            "power_idle_w": [56.0, 28.0, 0.5, np.nan, 1.0],
            "power_w": [56.005, 46.0, 2.25, 3.0, 1.0],
            "power_w_low": [56.0, 44.0, 2.0, 2.0, 1.0],
            "power_w_high": [56.005, 47.0, 2.75, 4.0, 1.0],
        }
    )


def test_bars_at_rest_and_beyond():
    found = FIGURE.gather(study(points()))
    assert found.hardware == ("CPU", "GPU", "<Loihi 2>")
    assert found.idle_w.tolist() == [56, 28, 0.5]
    assert found.beyond_w == pytest.approx([0.005, 18, 1.75])
    assert found.low_w == pytest.approx([0.005, 2, 0.25]) and found.high_w == pytest.approx([0, 1, 0.5])
    assert found.without == ("other",)
    figure = FIGURE.draw(found)
    assert [bar.name for bar in figure.data] == ["at rest", "beyond, running"]
    assert figure.layout.barmode == "stack"
    assert figure.layout.xaxis.title.text == "power (W)<br>not known: other"
    notes = [note.text for note in figure.layout.annotations]
    assert notes == ["56 W + 5 mW", "28 W + 18 W", "500 mW + 1.75 W"]
    assert list(figure.layout.yaxis.ticktext) == ["CPU", "GPU", "&lt;Loihi 2&gt;"]
    assert list(figure.data[1].error_x.array) == pytest.approx([0, 1, 0.5])


def test_what_it_refuses():
    with pytest.raises(NothingRecorded, match="must be known on some hardware, got none on other"):
        FIGURE.gather(study(points().iloc[3:4]))
