"""The price of 0.01 of accuracy: by hand, with the numbers of the page's own test."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from dse.show.figures.price import PriceFigure, price_of

GOALS = [("accuracy", "max"), ("energy_uj", "min")]


def results(**columns):
    frame = pd.DataFrame(
        {"trial": range(4), "accuracy": [0.80, 0.90, 0.95, 0.90], "energy_uj": [10, 30, 60, 90.0]}
    )
    return SimpleNamespace(points=lambda: frame.assign(**columns), objectives=GOALS)


def test_prices_by_hand():
    gain, cost = np.array([0.80, 0.90, 0.95]), np.array([10.0, 30.0, 60.0])
    exact, noisy = (price_of(gain, cost, np.full(3, error), 2) for error in (0, 0.06))
    # 0.95 at 60 against 0.90 at 30: 0.05 for 30.
    assert exact == pytest.approx((6, 6, 6, 30, 60))
    assert noisy == pytest.approx((6, 30 / (5 + 1.645 * 6 * 2**0.5), np.inf, 30, 60))
    assert price_of(gain[2:], cost[2:], np.zeros(1), 0) is None, "nothing is cheaper"
    equal = np.array([0.9, 0.9])
    assert price_of(equal, np.array([1.0, 2.0]), np.zeros(2), 1) is None, "nothing is gained for what is paid"


def test_a_price_lies_in_its_own_interval():
    rng = np.random.default_rng(7)
    found = []
    for _ in range(200):
        gain = rng.uniform(0.8, 0.95, 60)
        cost, error = np.exp(8 * gain + rng.normal(0, 0.5, 60)), rng.uniform(0.002, 0.04, 60)
        found.append(price_of(gain, cost, error, int(gain.argmax())))
    priced = [one for one in found if one is not None]
    assert len(priced) > 50
    assert all(low <= price <= high for price, low, high, _, _ in priced)


def test_prices_of_a_study_are_drawn_with_their_numbers():
    record = PriceFigure().gather(results(n_weights=[5, 7, 9, 1], fits=True))
    assert (record.gain, record.trial, record.columns) == ("accuracy", 2, ("energy_uj", "n_weights"))
    assert record.price.tolist() == pytest.approx([6, 1.6])  # 0.90 with 1 weight, on the way to 9
    figure = PriceFigure().draw(record)
    assert list(figure.data[0].x) == pytest.approx([10, 100 * 1.6 / 9])
    assert [note.text for note in figure.layout.annotations] == ["6 µJ (6 to 6)", "1.6 (1.6 to 1.6)"]
    beyond = dataclasses.replace(record, high=np.array([np.inf, 2.0]))
    assert PriceFigure().draw(beyond).layout.annotations[0].text == "at least 6 µJ"


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"accuracy": 0.9}, "no point with accuracy at most 0.05 below 0.900 is cheaper"),
        ({"accuracy": [1, 2, 3, 4]}, r"accuracy must be a fraction, in \[0, 1\], of some points"),
    ],
)
def test_what_has_no_price_is_said(columns, message):
    with pytest.raises(ValueError, match=message):
        PriceFigure().gather(results(**columns))
