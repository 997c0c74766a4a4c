"""The importance of parameters as a figure: the one that decides is on top."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from dse.figures.importance import ImportanceFigure


def results(n=40):
    rng = np.random.default_rng(0)
    hidden, delay = rng.integers(1, 9, n), rng.integers(0, 3, n)
    frame = pd.DataFrame({"trial": range(n), "task": "t", "model.delay": delay, "model.hidden": hidden})
    frame["accuracy"] = hidden / 10
    return SimpleNamespace(points=lambda: frame, objectives=[("accuracy", "max")])


def test_the_parameter_that_decides_is_on_top():
    record = ImportanceFigure().gather(results())
    assert record.names[0] == "model.hidden"
    assert record.importance[0] > 5 * record.importance[1]
    (bars,) = ImportanceFigure().draw(record).data
    assert list(bars.y) == list(record.names)
    assert list(bars.error_x.array) == list(record.se)


def test_what_has_no_importance_is_said():
    with pytest.raises(ValueError, match="accuracy needs 10 designs"):
        ImportanceFigure().gather(results(5))
    with pytest.raises(ValueError, match="objective must be a column of the points, got 'speed'"):
        ImportanceFigure("speed").gather(results())
