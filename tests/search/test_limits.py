import math

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.search.limits import MISSING, can_meet, exclusion
from dse.skyline.constraints import matches

ROW = {
    "n_weights": (38880.0, 38880.0),
    "energy_uj": (12.0, math.inf),
    "fits": (0.0, 0.0),
    "maybe": (0.0, 1.0),
    "task": "texture",
    "model.hidden": (40.0, 40.0),
    "model.elm.hidden": MISSING,
}


@pytest.mark.parametrize(
    ("limit", "expected"),
    [
        ("n_weights <= 38880", True),
        ("n_weights < 38880", False),
        ("n_weights != 38880", False),
        ("20000 >= n_weights", False),
        ("energy_uj <= 50", True),
        ("energy_uj <= 12", True),
        ("energy_uj < 12", False),
        ("energy_uj <= 10", False),
        ("energy_uj > 1e9", True),
        ("10 < energy_uj < 11", False),
        ("not energy_uj > 10", False),
        ("fits", False),
        ("not fits", True),
        ("maybe", True),
        ("not maybe", True),
        ("task == 'texture'", True),
        ("task in ['speed', 'profile']", False),
        ("task not in ['speed']", True),
        ("energy_uj in [1, 2]", False),
        ("energy_uj not in [13]", True),
        ("model.elm.hidden <= 10", False),
        ("not model.elm.hidden <= 10", True),
        ("model.elm.hidden not in [3]", False),
        ("model.hidden > 40 or energy_uj <= 20", True),
        ("model.hidden > 40 and energy_uj <= 20", False),
        ("unknown <= 3", True),
    ],
)
def test_a_limit_is_met_where_some_numbers_meet_it(limit, expected):
    assert can_meet(limit, ROW) is expected


def test_one_chip_must_be_able_to_meet_all():
    limits = ("fits", "energy_uj <= 20")
    small = {"fits": (1.0, 1.0), "energy_uj": (30.0, math.inf)}
    large = {"fits": (0.0, 0.0), "energy_uj": (10.0, math.inf)}
    assert exclusion(limits, {"a": small | {"energy_uj": (1.0, 2.0)}, "b": large}) is None
    why = exclusion(limits, {"small": small, "large": large})
    assert why.limits == ()  # each can be met, not both at once
    assert why.reason == "cannot meet energy_uj <= 20: energy_uj is at least 30 on small"


numbers = st.integers(-3, 3)
tests = st.builds(
    lambda a, sign, b: f"{a} {sign} {b}",
    st.sampled_from(["x", "y"]),
    st.sampled_from(["<", "<=", ">", ">=", "==", "!="]),
    st.one_of(st.sampled_from(["x", "y"]), numbers.map(str)),
) | st.builds(lambda a, xs: f"{a} in {xs}", st.sampled_from(["x", "y"]), st.lists(numbers, min_size=1))
conditions = st.recursive(
    tests,
    lambda inner: (
        st.builds(lambda a, join, b: f"({a} {join} {b})", inner, st.sampled_from(["and", "or"]), inner)
        | st.builds(lambda a: f"(not {a})", inner)
    ),
    max_leaves=4,
)


@given(conditions, numbers, numbers, st.integers(0, 3), st.integers(0, 3))
def test_what_can_be_met_in_a_table_is_not_excluded(limit, x, y, wide, high):
    row = {"x": (float(x), float(x + wide)), "y": (float(y), float(y + high))}
    grid = [
        (a / 2, b / 2) for a in range(2 * x, 2 * (x + wide) + 1) for b in range(2 * y, 2 * (y + high) + 1)
    ]
    met = matches(limit, pd.DataFrame(np.array(grid, float), columns=["x", "y"]))
    assert can_meet(limit, row) or not met.any()
    if wide == high == 0:
        assert can_meet(limit, row) == met.all()
