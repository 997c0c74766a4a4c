"""The importance of parameters as a figure: the one that decides is on top."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from dse.show.figures.importance import ImportanceFigure, gather_importance


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


def test_the_forest_finds_what_matters_and_says_how_far_to_trust_it():
    rng = np.random.default_rng(0)
    n = 120
    hidden, kind = rng.choice([10, 20, 40], n), rng.choice(["a", "b"], n)
    frame = pd.DataFrame(
        {"trial": np.arange(n), "task": "texture", "model.hidden": hidden, "model.kind": kind}
    )
    frame["encoder.noise"] = rng.random(n)
    frame["accuracy"] = 0.5 + hidden / 100 + 0.05 * (kind == "b")
    frame["n_weights"] = rng.integers(1, 9, n)
    sized, noise = gather_importance(frame, {"accuracy": "max", "n_weights": "min"})
    assert [one["column"] for one in sized["parameters"]] == ["model.hidden", "model.kind", "encoder.noise"]
    assert sized["r2"] > 0.95 and sized["n"] == n and sized["parameters"][2]["importance"] < 0.01
    slices = {one["value"]: one for one in sized["parameters"][0]["slices"]}
    for each in (10, 20, 40):
        values = frame["accuracy"][hidden == each]
        assert slices[f"{each}"]["n"] == len(values)
        assert slices[f"{each}"]["mean"] == pytest.approx(values.mean(), rel=1e-3)
    assert noise["r2"] < 0.1, "random numbers cannot be predicted, and the page says so"
    binned = sized["parameters"][2]["slices"]
    assert len(binned) == 6 and sum(one["n"] for one in binned) == n
    assert gather_importance(frame.head(9), {"accuracy": "max"}) == []
