"""Designs on a chip: order of energies, ratios over draws and accuracies that are as good, all by hand."""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pandas as pd
import pytest

from dse.report.designs import StudyTask
from dse.report.hardware import (
    AT_PERIOD,
    FLAT_OUT,
    Chip,
    Choice,
    Level,
    Ratio,
    accuracy_error,
    common_level,
    ratio,
    reached,
)

# 20 draws: the 5 % quantile is the smallest, the 95 % quantile the second largest.
STEADY = np.full(20, 10.0)
NEAR = np.array([9.0, *[11.0] * 17, 12.0, 14.0])


def part(n_validation):
    return cast(StudyTask, SimpleNamespace(n_validation=n_validation))


def chip(name, designs, fits=()):
    """Return a chip from accuracy, energy and weights of each design; at the period it takes 1 / energy."""
    accuracy, energies, n_weights = (np.array(values, float) for values in zip(*designs, strict=True))
    columns = {"trial": range(len(designs)), "accuracy": accuracy, "n_weights": n_weights}
    table = pd.DataFrame(columns).assign(accuracy_se=0.02, repeats=1, energy_uj=energies)
    drawn = {FLAT_OUT: np.stack([energies] * 3), AT_PERIOD: np.stack([1 / energies] * 3)}
    return Chip(name, table, drawn, np.array(fits or [True] * len(designs)) & np.isfinite(energies))


def test_energies_over_draws():
    # NEAR over STEADY: 0.9, 17 times 1.1, 1.2, 1.4; more of them is said of studies (test_hardware).
    assert ratio(STEADY, NEAR) == pytest.approx((1.1, 0.9, 1.2, 0.95))
    assert ratio(np.zeros(20), np.zeros(20)) == (1.0, 1.0, 1.0, 0.0), "nothing is as much as nothing"
    assert ratio(np.zeros(20), STEADY) == (np.inf, np.inf, np.inf, 1.0)
    # Of two chips every draw meets every draw: 4 / 2, 4 / 1, 1 / 2 and 1 / 1.
    one, more = (
        Choice(replace(chip("x", [(0.9, 5, 1)]), energies_uj={FLAT_OUT: np.array(drawn)[:, None]}), 0)
        for drawn in ([2.0, 1.0], [4.0, 1.0])
    )
    assert more.over(one, FLAT_OUT) == ((1.0, 0.5, 4.0, 0.5), True)
    assert Ratio(2.0, 1.1, 3.0, 0.97).is_beyond and Ratio(0.5, 0.2, 0.9, 0.0).is_beyond
    assert not Ratio(2.0, 0.9, 3.0, 0.9).is_beyond and not Ratio(1.0, 1.0, 1.0, 0.0).is_beyond


def test_few_recordings_count_as_well_as_runs():
    # Wilson: 0.5 of 100 is sqrt(0.25 / 100 + 0.25 / 10000) / 1.01 = 0.04975
    row = pd.Series({"accuracy": 0.5, "accuracy_se": 0.002})
    assert accuracy_error(part(100), row) == pytest.approx(0.04975, abs=1e-5)
    assert accuracy_error(part(100), row.replace(0.002, 0.06)) == 0.06
    assert accuracy_error(part(100), row.replace(0.002, np.nan)) == pytest.approx(0.04975, abs=1e-5)
    assert accuracy_error(part(0), row) == 0.002, "records that do not say how many recordings"
    assert accuracy_error(part(0), row.replace(0.002, np.nan)) == 0


def test_designs_are_ranked_by_energy_then_weights():
    one = chip("one", [(0.9, 5, 70), (0.8, 3, 90), (0.9, 3, 80), (0.85, 3, 80), (0.9, 3, 80), (0.7, 1, 10)])
    assert one.ranked(0.8) == [2, 4, 3, 1, 0]
    assert one.ranked(0.8, AT_PERIOD) == [0, 2, 4, 3, 1]
    assert one.ranked(0.95) == []
    near = chip("near", [(0.9, 1826.8, 80), (0.9, 1826.9, 70), (0.9, 1815.0, 90)])
    assert near.ranked(0.9) == [2, 1, 0], "what agrees in three digits is a tie"


def test_what_cannot_run_or_does_not_fit_is_not_ranked_or_reached():
    one = chip("one", [(0.9, np.nan, 1), (0.9, 2, 1), (0.9, 3, 1)], fits=[True, False, True])
    assert one.ranked(0.0) == [2] and one.has_values
    some = [(0.9, 5, 1), (0.7, 1, 1)]
    level = reached(part(0), chip("one", some, fits=[False, True]))
    assert level == (0.7, 0.02) and level.least == pytest.approx(0.68)
    assert reached(part(0), chip("none", some, fits=[False, False])) is None
    assert common_level([Level(0.9, 0.01), Level(0.7, 0.02), Level(0.8, 0.3)]) == (0.7, 0.02)
    assert common_level([Level(0.7, 0.01), Level(0.7, 0.02)]) == (0.7, 0.02), "of equals the less certain"
