"""Rank correlations by hand, against scipy, and where they are not defined."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from dse_papers.report.correlation import spearman


def test_ranks_alone_count():
    assert spearman([1, 2, 3, 4], [1, 10, 100, 1000]) == 1.0
    assert spearman([1, 2, 3, 4], [0.4, 0.3, 0.2, -np.inf]) == -1.0
    # Ranks 1 2 3 4 and 1 3 2 4: 1 - 6 (0 + 1 + 1 + 0) / (4 (16 - 1)).
    assert spearman([1, 2, 3, 4], [5, 7, 6, 9]) == pytest.approx(1 - 12 / 60)


def test_equal_values_share_their_mean_rank():
    # Ranks 1 2.5 2.5 4 and 1 2 3 4: covariance 4.5, variances 4.5 and 5.
    assert spearman([1, 2, 2, 3], [1, 2, 3, 4]) == pytest.approx(4.5 / math.sqrt(4.5 * 5))


def test_nan_rows_are_dropped():
    assert spearman([1, 2, np.nan, 3, 9], [3, 2, 8, 1, np.nan]) == -1.0


@pytest.mark.parametrize(
    ("x", "y"),
    [
        ([1, 2, 3], [4, 4, 4]),
        ([0.1] * 7, range(7)),
        ([1, 2], [1, 2]),
        ([], []),
        ([1, 2, 3, np.nan], [1, 1, 1, 2]),
        ([1, np.nan, 3], [1, 2, 3]),
    ],
    ids=[
        "constant",
        "constant without variance",
        "two rows",
        "none",
        "constant once NaN is gone",
        "two left",
    ],
)
def test_what_is_not_defined_is_nan_and_not_0(x, y):
    assert math.isnan(spearman(x, y))
    assert math.isnan(spearman(y, x))


def test_columns_of_other_lengths_are_refused():
    with pytest.raises(ValueError, match=r"of one length, got \(3,\) and \(2,\)"):
        spearman([1, 2, 3], [1, 2])


@given(st.lists(st.tuples(st.integers(-4, 4), st.floats(-1e6, 1e6)), min_size=3, max_size=30))
def test_it_is_scipys_where_that_is_defined(rows):
    x, y = (np.array(column, float) for column in zip(*rows, strict=True))
    found = spearman(x, y)
    if len(set(x)) == 1 or len(set(y)) == 1:
        assert math.isnan(found)
    else:
        assert found == pytest.approx(stats.spearmanr(x, y).statistic, abs=1e-12)
        assert found == pytest.approx(spearman(y, x), abs=1e-12)
