"""The fronts that a search goes on from: also where nothing fits yet."""

import numpy as np
import pandas as pd

from dse.study.precision import fronts

GOALS = [("accuracy", "max"), ("n_weights", "min")]
POINTS = pd.DataFrame(
    {
        "trial": [0, 1, 2],
        "task": "t",
        "family": ["snn", "snn", "mlp"],
        "hardware": "chip",
        "accuracy": [0.9, 0.8, 0.99],
        "n_weights": [20, 10, 5],
        "fits": pd.array([False, False, None], dtype="boolean"),
        "energy_uj_high": [2.0, 1.0, np.nan],
    }
)


def on_fronts(points):
    return [trial for _, front in fronts(points, GOALS) for trial in front["trial"]]


def test_where_nothing_fits_the_search_goes_on_as_on_a_larger_chip_and_where_something_does_from_that():
    assert on_fronts(POINTS) == [0, 1], "what the chip cannot run is on no front"
    assert on_fronts(POINTS.assign(fits=pd.array([False, True, None], dtype="boolean"))) == [1]
    both = pd.concat(
        [POINTS, POINTS.assign(hardware="other", fits=True, energy_uj_high=1.0)], ignore_index=True
    )
    assert sorted(on_fronts(both)) == [0, 0, 1, 1, 2]
