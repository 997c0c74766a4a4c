"""Designs on a chip: order of energies, ratios over draws and accuracies that are as good, all by hand."""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pandas as pd
import pytest

from dse.show.report.designs import StudyTask
from dse.show.report.hardware import AT_PERIOD, FLAT_OUT, Chip, Choice, Ratio, accuracy_error, reached


def part(n_validation):
    return cast(StudyTask, SimpleNamespace(n_validation=n_validation))


def chip(name, designs, fits=()):
    """Return a chip from accuracy, energy and weights of each design; at the period it takes 1 / energy."""
    accuracy, energies, n_weights = (np.array(values, float) for values in zip(*designs, strict=True))
    columns = {"trial": range(len(designs)), "accuracy": accuracy, "n_weights": n_weights}
    table = pd.DataFrame(columns).assign(accuracy_se=0.02, repeats=1, energy_uj=energies)
    drawn = {FLAT_OUT: np.stack([energies] * 3), AT_PERIOD: np.stack([1 / energies] * 3)}
    return Chip(name, table, drawn, np.array(fits or [True] * len(designs)) & np.isfinite(energies))


def drawn(*energies_uj):
    """Return a design of which only the energies of the draws matter."""
    energies = {FLAT_OUT: np.array(energies_uj)[:, None]}
    return Choice(replace(chip("x", [(0.9, 5, 1)]), energies_uj=energies), 0, FLAT_OUT)


def test_energies_over_draws():
    # Every draw meets every draw: 4 / 2, 4 / 1, 1 / 2 and 1 / 1.
    assert drawn(4.0, 1.0).over(drawn(2.0, 1.0)) == (1.0, 0.5, 4.0, 0.5, True)
    assert drawn(0.0).over(drawn(0.0)) == (1.0, 1.0, 1.0, 0.0, True), "nothing is as much as nothing"
    assert drawn(10.0).over(drawn(0.0)) == (np.inf, np.inf, np.inf, 1.0, True)
    for low, high, how in (
        (1.1, 3.0, "beyond"),
        (0.2, 0.9, "beyond"),
        (0.9, 3.0, "within"),
        (1, 1, "within"),
    ):
        assert f"{how} the uncertainty" in str(Ratio(2.0, low, high, 0.9, True))


def test_few_recordings_count_as_well_as_runs():
    # Wilson: 0.5 of 100 is sqrt(0.25 / 100 + 0.25 / 10000) / 1.01 = 0.04975
    row = pd.Series({"accuracy": 0.5, "accuracy_se": 0.002})
    assert accuracy_error(part(100), row) == pytest.approx(0.04975, abs=1e-5)
    assert accuracy_error(part(100), row.replace(0.002, 0.06)) == 0.06
    assert accuracy_error(part(100), row.replace(0.002, np.nan)) == pytest.approx(0.04975, abs=1e-5)
    assert accuracy_error(part(0), row) == 0.002, "records that do not say how many recordings"
    assert accuracy_error(part(0), row.replace(0.002, np.nan)) == 0


def cheapest(chip, least, column=FLAT_OUT):
    choice = chip.cheapest(least, column)
    return None if choice is None else choice.design


def test_the_cheapest_design_by_energy_then_weights():
    one = chip("one", [(0.9, 5, 70), (0.8, 3, 90), (0.9, 3, 80), (0.85, 3, 80), (0.9, 3, 80), (0.7, 1, 10)])
    assert [cheapest(one, least) for least in (0.7, 0.8, 0.95)] == [5, 2, None]
    assert cheapest(one, 0.8, AT_PERIOD) == 0
    near = chip("near", [(0.9, 1826.8, 80), (0.9, 1826.9, 70)])
    assert cheapest(near, 0.9) == 1, "what agrees in three digits is a tie"


def test_what_cannot_run_or_does_not_fit_is_not_chosen_or_reached():
    one = chip("one", [(0.9, np.nan, 1), (0.9, 2, 1), (0.9, 3, 1)], fits=[True, False, True])
    assert cheapest(one, 0.0) == 2 and one.has_values
    some = [(0.9, 5, 1), (0.7, 1, 1)]
    assert reached(part(0), chip("one", some, fits=[False, True])) == (0.7, 0.02)
    assert reached(part(0), chip("none", some, fits=[False, False])) is None
