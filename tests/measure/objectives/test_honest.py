"""Accuracy on moved windows and on unseen groups: means and standard errors by hand."""

from dataclasses import replace

import numpy as np
import pytest

from dse.measure.objectives import Points
from dse.measure.objectives.accuracy import wilson_se
from dse.measure.objectives.accuracy_shifted import AccuracyShifted
from dse.measure.objectives.accuracy_unseen import as_arrays, merged, unseen_columns
from dse.testing.small import records


def test_several_columns_and_runs():
    first = {"force": {"1": 0.5, "3": 0.7}, "fabric": {"a": 0.2}}
    second = {"force": {"1": 0.7, "2": 0.9}, "fabric": {"b": 0.4}}
    unseen = merged([as_arrays(first), as_arrays(second), {}])
    assert unseen == {"force": {"1": 0.6, "3": 0.7, "2": 0.9}, "fabric": {"a": 0.2, "b": 0.4}}
    columns = unseen_columns(unseen)
    assert columns["accuracy_unseen_force"] == pytest.approx(2.2 / 3)
    deviations = np.array([0.6, 0.7, 0.9]) - 2.2 / 3
    of_force = np.sqrt((deviations**2).sum() / 2 / 3)
    assert columns["accuracy_unseen_force_se"] == pytest.approx(of_force)
    assert columns["accuracy_unseen_fabric"] == pytest.approx(0.3)
    assert columns["accuracy_unseen_fabric_se"] == pytest.approx(0.1)
    assert columns["accuracy_unseen"] == pytest.approx((2.2 / 3 + 0.3) / 2)
    assert columns["accuracy_unseen_se"] == pytest.approx(np.hypot(of_force, 0.1) / 2)


def test_one_fold_has_no_error_and_nothing_has_no_columns():
    columns = unseen_columns(as_arrays({"force": {"1": 0.5}}))
    assert columns["accuracy_unseen"] == 0.5 and np.isnan(columns["accuracy_unseen_se"])
    assert unseen_columns({}) == {} == merged([])


def test_shifts_of_several_points():
    points = next(x for x in records()["points"] if isinstance(x, Points))
    shifted = np.array([[1.0, 0.5], [0.5, 0.5], [0.0, 0.2]])
    columns = AccuracyShifted().measure(replace(points, shifted=shifted, unshifted=shifted[0], n_shifted=10))
    assert columns["accuracy_unshifted"].tolist() == [1.0, 0.5]
    assert columns["accuracy_shifted"].tolist() == pytest.approx([0.5, 0.4])
    assert columns["accuracy_shifted_min"].tolist() == [0.0, 0.2]
    assert columns["accuracy_shifted_se"].tolist() == pytest.approx(wilson_se([5, 4], 10).tolist())
    assert columns["accuracy_shifted_min_se"].tolist() == pytest.approx(wilson_se([0, 2], 10).tolist())
    assert columns["n_shifted"].tolist() == [10, 10]
    assert AccuracyShifted().measure(replace(points, shifted=None)) == {}
