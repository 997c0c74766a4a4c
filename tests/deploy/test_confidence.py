"""The confidence rule in whole numbers decides as float64 does."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.deploy.form import simplest_fraction


@pytest.mark.parametrize(
    ("theta", "fraction"),
    [
        (0.0, Fraction(0)),
        (0.35, Fraction(7, 20)),
        (0.5, Fraction(1, 2)),
        (1.0, Fraction(1)),
        (2 / 3, Fraction(2, 3)),
    ],
)
def test_round_thresholds_are_the_fractions_they_mean(theta, fraction):
    assert simplest_fraction(theta, 500) == fraction


def test_a_hair_more_than_a_fraction_excludes_it():
    theta = 0.2 + 3 * 0.05
    assert theta > 0.35 and simplest_fraction(theta, 500) > Fraction(7, 20)


@given(theta=st.floats(0, 1), largest=st.integers(1, 90))
def test_every_count_passes_as_its_quotient(theta, largest):
    fraction = simplest_fraction(theta, largest)
    for total in range(1, largest + 1):
        count = np.arange(total + 1)
        exact = count * fraction.denominator >= total * fraction.numerator
        assert np.array_equal(exact, count / total >= theta)
