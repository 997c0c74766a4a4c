"""Chips side by side: their picks, and the cheapest design at the accuracy that all reach, by hand."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from dse.show.figures.chips import ChipsFigure

GOALS = [("accuracy", "max"), ("energy_uj", "min")]


def results():
    frame = pd.DataFrame(
        {"trial": range(4), "accuracy": [0.80, 0.90, 0.95, 0.90], "energy_uj": [10, 30, 60, 90.0]}
    )
    return SimpleNamespace(points=lambda: frame, objectives=GOALS)


def test_chips_by_hand():
    small = results().points().assign(hardware="small", energy_uj_low=5.0, energy_uj_high=100.0, fits=True)
    large = small.assign(hardware="large", energy_uj=small["energy_uj"] / 10, fits=[True, True, False, True])
    blind = small.assign(hardware="blind", energy_uj=np.nan)
    study = results()
    study.points = lambda: pd.concat([small, large, blind], ignore_index=True)
    record = ChipsFigure().gather(study)
    assert record.hardware == ("small", "large") and record.without == ("blind",)
    assert record.level == 0.9, "trial 2 does not fit the large chip"
    assert record.pick_gain.tolist() == [0.95, 0.9]
    assert record.pick[:, 0].tolist() == [60, 3]
    assert record.least[:, 0].tolist() == [30, 3]
    assert tuple(record.least[0, 1:]) == (25, 70)
    figure = ChipsFigure().draw(record)
    assert figure.layout.xaxis.type == "log" and list(figure.data[1].x) == [30, 3]
    assert "not known: blind" in figure.layout.xaxis.title.text
    with pytest.raises(ValueError, match="points must be on hardware, got a study without it"):
        ChipsFigure().gather(results())
    with pytest.raises(ValueError, match="cost must be a column of the points, got 'money'"):
        ChipsFigure("money").gather(study)
