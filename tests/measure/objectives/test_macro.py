"""Macro means, counted by hand."""

from __future__ import annotations

import numpy as np
import pytest

from dse.measure.objectives.macro import macro


def test_three_classes_by_hand() -> None:
    # recall 3/4, 1/2, 1; precision 3/4, 1/3, 2/2
    found = macro([[3, 1, 0], [1, 1, 0], [0, 1, 2]])
    assert found.recall == pytest.approx((3 / 4 + 1 / 2 + 2 / 3) / 3)
    assert found.precision == pytest.approx((3 / 4 + 1 / 3 + 1) / 3)
    assert found.f1 == pytest.approx((6 / 8 + 2 / 5 + 4 / 5) / 3)


def test_a_class_never_answered_has_precision_0() -> None:
    assert macro([[2, 0], [2, 0]]) == pytest.approx((1 / 2, 1 / 4, (4 / 6 + 0) / 2))


def test_a_class_without_samples_is_left_out_but_answers_of_it_are_wrong() -> None:
    assert macro([[1, 1], [0, 0]]) == pytest.approx((1 / 2, 1, 2 / 3))


def test_answers_that_are_no_class_are_wrong() -> None:
    assert macro([[1, 0, 1], [0, 2, 0]]) == pytest.approx((3 / 4, 1, (2 / 3 + 1) / 2))


def test_without_samples_there_is_no_mean() -> None:
    assert np.isnan(macro(np.zeros((2, 2)))).all()


@pytest.mark.parametrize(
    "counts", [[1, 2], [[1, 2], [3, 4], [5, 6]], [[1, -1], [0, 1]], [[np.nan, 0], [0, 1]]]
)
def test_what_is_no_confusion(counts: object) -> None:
    with pytest.raises(ValueError, match="confusion must be a matrix of counts >= 0"):
        macro(counts)  # type: ignore[arg-type]
