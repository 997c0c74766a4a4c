"""Where all points lie: every point is counted once, by task and hardware, on the axes of the page."""

import numpy as np
import pandas as pd

from dse.dashboard.bins import N_BINS, gather_bins
from tests.page_data import OBJECTIVES, points


def test_every_point_with_both_numbers_is_in_one_cell():
    rng = np.random.default_rng(3)
    n = 5000
    frame = pd.DataFrame(
        {
            "task": rng.choice(["texture", "velocity"], n),
            "accuracy": rng.uniform(0.2, 1, n),
            "energy_uj": 10 ** rng.uniform(-1, 3, n),
            "n_weights": 7,
        }
    )
    frame.loc[:9, "energy_uj"] = np.nan
    found = gather_bins(frame, list(OBJECTIVES))
    assert [(bins["task"], bins["x"], bins["y"]) for bins in found] == [
        (task, "accuracy", "energy_uj") for task in dict.fromkeys(frame["task"])
    ]
    for bins in found:
        assert sum(n for *_, n in bins["counts"]) == (frame["task"] == bins["task"])[10:].sum()
        assert len(bins["x_edges"]) == len(bins["y_edges"]) == N_BINS + 1
        assert np.allclose(np.diff(np.log(bins["y_edges"])), np.log(bins["y_edges"][1] / bins["y_edges"][0]))
        assert np.allclose(np.diff(bins["x_edges"]), bins["x_edges"][1] - bins["x_edges"][0])


def test_a_cell_is_where_its_points_are():
    (bins,) = gather_bins(points().drop(columns=["task", "n_weights"]), ["accuracy", "energy_uj"])
    at = {(i, j) for i, j, _ in bins["counts"]}
    for accuracy, energy in zip(points()["accuracy"], points()["energy_uj"], strict=True):
        i = min(np.searchsorted(bins["x_edges"], accuracy, "right") - 1, N_BINS - 1)
        j = min(np.searchsorted(bins["y_edges"], energy, "right") - 1, N_BINS - 1)
        assert (i, j) in at


def test_nothing_and_one_value_have_no_bins():
    assert gather_bins(points().iloc[:0], list(OBJECTIVES)) == []
    assert gather_bins(points(accuracy=0.5, energy_uj=np.inf), list(OBJECTIVES)) == []
