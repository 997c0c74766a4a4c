import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.measure.confusion import confusion
from dse.measure.objectives.accuracy import seeds_se, wilson_se


@given(st.integers(1, 1000).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_wilson_is_where_the_score_test_is_at_one_sigma(counts):
    # The ends of the interval are the p at which k lies one standard deviation from n p.
    k, n = counts
    half = float(wilson_se(k, n))
    middle = (k / n + 0.5 / n) / (1 + 1 / n)
    for p in (middle - half, middle + half):
        assert (k - n * p) ** 2 == pytest.approx(n * p * (1 - p), rel=1e-6, abs=1e-9)


def test_wilson_by_hand_and_over_arrays():
    assert wilson_se(1, 1) == 0.25
    assert wilson_se([0, 50, 100], 100) == pytest.approx(
        [1 / 202, np.sqrt(0.0025 + 0.000025) / 1.01, 1 / 202]
    )


@pytest.mark.parametrize(("k", "n"), [(-1, 5), (6, 5), (0, 0), (np.nan, 5)])
def test_wilson_needs_counts(k, n):
    with pytest.raises(ValueError, match="0 <= k <= n"):
        wilson_se(k, n)


def test_seeds_se_is_the_error_of_the_mean():
    assert seeds_se([0.8, 0.9, 1.0]) == pytest.approx(0.1 / np.sqrt(3))
    assert seeds_se([[0.8, 1], [0.9, 1], [1.0, 1]]) == pytest.approx([0.1 / np.sqrt(3), 0])
    with pytest.raises(ValueError, match="at least two runs"):
        seeds_se([0.9])


def test_confusion_counts_true_rows_and_answered_columns():
    assert confusion([0, 1, 1, 2], [0, 0, 1, 1], 3).tolist() == [[1, 1, 0], [0, 1, 1], [0, 0, 0]]
    assert confusion(np.array([1], dtype=np.uint8), np.array([200], dtype=np.uint8), 201)[200, 1] == 1
    assert confusion([], [], 2).tolist() == [[0, 0], [0, 0]]


def test_confusion_names_classes_out_of_range():
    with pytest.raises(ValueError, match=r"label must be in 0\.\.1, got 0\.\.2"):
        confusion([0, 2], [0, 1], 2)
    with pytest.raises(ValueError, match=r"target must be in 0\.\.1, got -1\.\.1"):
        confusion([0, 1], [-1, 1], 2)
    with pytest.raises(ValueError, match="label and target must be"):
        confusion([0], [0, 1], 2)


def test_runs_that_agree_have_no_error_at_all():
    assert seeds_se([0.9006211180124224] * 3) == 0.0
    assert seeds_se([[0.1, 0.3], [0.1, 0.5], [0.1, 0.7]]).tolist() == [0.0, pytest.approx(0.2 / np.sqrt(3))]
