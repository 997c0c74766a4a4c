"""Predicted gains: against a written-out regression, their coverage, and what is dominated."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.search.racing import LEAST, Scale, covered, evenly, is_certain, most_gain


def test_most_gain_is_the_end_of_the_prediction_interval() -> None:
    x = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0])
    gain = np.array([1.0, 0.9, 0.9, 0.6, 0.7, 0.4, 0.5, 0.2])
    # By hand: slope -4.5 / 42, mean 0.65, residual sum of squares 0.06785714, t(0.95, 6) = 1.94318.
    s = math.sqrt((np.square(gain - 0.65).sum() - 4.5**2 / 42) / 6)
    at_10 = 0.65 - 4.5 / 42 * 6.5 + 1.943180 * s * math.sqrt(1 + 1 / 8 + 6.5**2 / 42)
    at_mean = 0.65 + 1.943180 * s * math.sqrt(1 + 1 / 8)
    found = most_gain(x, x + gain, np.array([10.0, 3.5]), 0.95)
    np.testing.assert_allclose(found, [max(at_10, 0), at_mean], rtol=1e-6)
    assert most_gain(x, x - 1, np.array([3.0]), 0.95) == 0  # a loss is never counted on


def test_few_or_equal_trainings_promise_everything_or_what_they_gained() -> None:
    x = np.arange(LEAST - 1.0)
    assert most_gain(x, x, np.array([1.0]), 0.9) == math.inf
    same, gain = np.full(LEAST, 2.0), np.linspace(0, 0.7, LEAST)
    near, far = most_gain(same, same + gain, np.array([2.0, 2.1]), 0.9)
    assert 0.7 < near < 1.5 and far == math.inf
    assert is_certain(same, same) and not is_certain(same, same + gain)


@pytest.mark.parametrize("confidence", [0.8, 0.95])
def test_gains_exceed_the_bound_as_often_as_stated(confidence: float) -> None:
    rng = np.random.default_rng(5)
    n_beyond, n = 0, 1000
    for _ in range(n):
        x = rng.normal(0, 1, 13)
        gain = 0.8 - 0.3 * x + rng.normal(0, 0.2, 13)
        n_beyond += gain[-1] > most_gain(x[:-1], (x + gain)[:-1], x[-1:], confidence)[0]
    assert n_beyond / n == pytest.approx(1 - confidence, abs=0.04)


def test_scales_go_there_and_back_and_grow_with_what_is_better() -> None:
    shares, costs, any_sign = np.array([0.0, 0.3, 1.0]), np.array([0.1, 2.0, 9.0]), np.array([-1.0, 0.0, 4.0])
    odds = Scale.of(shares, "max", 0.01)
    np.testing.assert_allclose(odds.back(odds.to(shares)), [0.01, 0.3, 0.99])
    for values, direction, kind in ((costs, "min", "log"), (any_sign, "min", "plain"), (costs, "max", "log")):
        scale = Scale.of(values, direction, 0.01)
        assert scale.kind == kind
        np.testing.assert_allclose(scale.back(scale.to(values)), values)
        assert (np.diff(scale.to(values)) > 0).all() == (direction == "max")
    assert np.isnan(Scale.of(costs, "min", 0.01).to(np.array([-1.0]))).all()


@given(
    st.lists(st.tuples(*[st.integers(0, 3)] * 3), min_size=1), st.lists(st.tuples(*[st.integers(0, 3)] * 3))
)
def test_what_is_covered_is_what_some_row_dominates(
    points: list[tuple[int, ...]], front: list[tuple[int, ...]]
) -> None:
    expected = [any(all(a >= b for a, b in zip(q, p, strict=True)) and q != p for q in front) for p in points]
    found = covered(np.array(points, float), np.array(front, float).reshape(len(front), 3))
    assert found.tolist() == expected


def test_scouts_are_spread_evenly() -> None:
    assert evenly([7, 5, 3], 4) == [7, 5, 3]
    assert evenly(list(range(9)), 3) == [0, 4, 8]
