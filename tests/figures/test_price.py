"""The price of a point of accuracy: by hand, with the numbers of the page's own test."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from dse.figures.price import PriceFigure, price_of

GOALS = [("accuracy", "max"), ("energy_uj", "min")]


def results(**columns):
    frame = pd.DataFrame(
        {"trial": range(4), "accuracy": [0.80, 0.90, 0.95, 0.90], "energy_uj": [10, 30, 60, 90.0]}
    )
    return SimpleNamespace(points=lambda: frame.assign(**columns), objectives=GOALS)


def test_prices_by_hand():
    gain, cost = np.array([0.80, 0.90, 0.95]), np.array([10.0, 30.0, 60.0])
    exact, noisy = (price_of(gain, cost, np.full(3, error), np.arange(3), 2) for error in (0, 0.06))
    # From 0.95 - 0.05 = 0.90 at 30 to 0.95 at 60: five points for 30.
    assert exact == (6, 6, 6, 30, 60)
    assert noisy[1] < 6 <= noisy[2] <= 10 and noisy[0] == 6
    assert price_of(gain[2:], cost[2:], np.zeros(1), np.arange(1), 0) is None, "nothing lies below"
    # Points of one trial err alike: what one gains, the other does.
    alike = price_of(gain, cost, np.full(3, 0.06), np.zeros(3, int), 2)
    assert alike == exact


def test_prices_of_a_study_are_drawn_with_their_numbers():
    record = PriceFigure().gather(results(n_weights=[5, 7, 9, 1], fits=True))
    assert (record.gain, record.trial, record.columns) == ("accuracy", 2, ("energy_uj", "n_weights"))
    assert record.price.tolist() == [6, pytest.approx(1.6)]  # 0.90 with 1 weight, on the way to 9
    figure = PriceFigure().draw(record)
    assert list(figure.data[0].x) == pytest.approx([10, 100 * 1.6 / 9])
    assert [note.text for note in figure.layout.annotations] == ["6 µJ (6 to 6)", "1.6 (1.6 to 1.6)"]
    beyond = dataclasses.replace(record, high=np.array([np.inf, 2.0]))
    assert PriceFigure().draw(beyond).layout.annotations[0].text == "6 µJ (6 to ∞)"


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"accuracy": 0.9}, "no point has accuracy more than 0.05 below the pick's 0.900"),
        ({"accuracy": [1, 2, 3, 4]}, r"accuracy must be a fraction, in \[0, 1\], of some points"),
    ],
)
def test_what_has_no_price_is_said(columns, message):
    with pytest.raises(ValueError, match=message):
        PriceFigure().gather(results(**columns))
