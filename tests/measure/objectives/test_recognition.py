import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from dse.measure.objectives.recognition import itr_bits, itr_bits_per_s, macro

counts = arrays.arrays(np.int64, st.integers(2, 5).map(lambda n: (n, n)), elements=st.integers(0, 20))


@pytest.mark.parametrize("n", [2, 7, 26])
def test_always_right_is_log2_of_the_classes(n):
    assert itr_bits(5 * np.eye(n)) == pytest.approx(np.log2(n))
    assert itr_bits(5 * np.roll(np.eye(n), 1, axis=0)) == pytest.approx(np.log2(n))  # always the same mistake


def test_a_matrix_by_hand():
    # p(L) = 1/2 each, p(R) = (5/8, 3/8): 1/2 (3/4 lb 6/5 + 1/4 lb 2/3) + 1/2 (1/2 lb 4/5 + 1/2 lb 4/3)
    by_hand = 0.5 * (0.75 * np.log2(6 / 5) + 0.25 * np.log2(2 / 3)) + 0.25 * (np.log2(4 / 5) + np.log2(4 / 3))
    assert itr_bits([[6, 2], [4, 4]]) == pytest.approx(by_hand, abs=1e-12)


def test_no_samples_and_classes_without_samples():
    assert np.isnan(itr_bits(np.zeros((3, 3))))
    assert np.isnan(itr_bits(np.zeros((0, 0))))
    assert itr_bits([[4, 0, 0], [0, 0, 0], [0, 0, 4]]) == pytest.approx(1.0)


@given(counts)
def test_bounds_and_symmetries(matrix):
    bits = itr_bits(matrix)
    if matrix.sum() == 0:
        assert np.isnan(bits)
        return
    p = matrix.sum(axis=1)[matrix.sum(axis=1) > 0] / matrix.sum()
    assert 0 <= bits <= -(p * np.log2(p)).sum() + 1e-9  # never more than the labels hold
    assert itr_bits(matrix.T) == pytest.approx(bits, abs=1e-12)
    assert itr_bits(3 * matrix[::-1]) == pytest.approx(bits, abs=1e-12)


@pytest.mark.parametrize("wrong", [[1.0, 2.0], [[1, -1], [0, 1]], [[np.nan, 1], [0, 1]]])
def test_what_is_no_confusion_matrix(wrong):
    with pytest.raises(ValueError, match="confusion must be a matrix of counts >= 0"):
        itr_bits(wrong)


def test_per_second():
    assert itr_bits_per_s(3.0, 250.0) == 12.0
    assert np.isnan(itr_bits_per_s(float("nan"), 250.0))
    with pytest.raises(ValueError, match="decision_ms must be > 0, got 0"):
        itr_bits_per_s(1.0, 0.0)


def test_three_classes_by_hand():
    # recall 3/4, 1/2, 1; precision 3/4, 1/3, 2/2
    found = macro([[3, 1, 0], [1, 1, 0], [0, 1, 2]])
    assert found.recall == pytest.approx((3 / 4 + 1 / 2 + 2 / 3) / 3)
    assert found.precision == pytest.approx((3 / 4 + 1 / 3 + 1) / 3)
    assert found.f1 == pytest.approx((6 / 8 + 2 / 5 + 4 / 5) / 3)


def test_a_class_never_answered_has_precision_0_and_without_samples_there_is_no_mean():
    assert macro([[2, 0], [2, 0]]) == pytest.approx((1 / 2, 1 / 4, (4 / 6 + 0) / 2))
    assert np.isnan(macro(np.zeros((2, 2)))).all()


def test_a_class_without_samples_is_left_out_but_answers_of_it_are_wrong():
    assert macro([[1, 1], [0, 0]]) == pytest.approx((1 / 2, 1, 2 / 3))


def test_answers_that_are_no_class_are_wrong():
    assert macro([[1, 0, 1], [0, 2, 0]]) == pytest.approx((3 / 4, 1, (2 / 3 + 1) / 2))


@pytest.mark.parametrize(
    "counts", [[1, 2], [[1, 2], [3, 4], [5, 6]], [[1, -1], [0, 1]], [[np.nan, 0], [0, 1]]]
)
def test_what_is_no_confusion(counts):
    with pytest.raises(ValueError, match="confusion must be a matrix of counts >= 0"):
        macro(counts)
