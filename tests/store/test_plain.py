"""Records and numbers as JSON holds them."""

import json
import math

import numpy as np
import pandas as pd
import pytest

from dse import store
from dse.base.records import Head


def test_numbers_of_numpy_become_pythons_own():
    document = {1: np.float32(0.5), "a": (np.arange(2), [np.bool_(True)]), "nan": np.float64("nan")}
    plain = store.plain(document)
    assert plain.pop("nan") != 0 and math.isnan(document["nan"])
    assert plain == {"1": 0.5, "a": [[0, 1], [True]]}
    assert [type(x) for x in (plain["1"], plain["a"][0][0], plain["a"][1][0])] == [float, int, bool]
    with pytest.raises(TypeError, match="set cannot be written as JSON"):
        store.plain({"a": {1}})


@pytest.mark.parametrize(
    ("cell", "expected"),
    [
        (float("nan"), None),
        (float("-inf"), None),
        (np.float64(2.5), 2.5),
        (np.int64(3), 3),
        (np.array([1.0, np.nan]), [1.0, None]),
        ({"a": (1, pd.NA)}, {"a": [1, None]}),
        (pd.NaT, None),
        (True, True),
        ("silk", "silk"),
        (pd.Timestamp("2026-01-02"), "2026-01-02 00:00:00"),
    ],
)
def test_a_cell_of_a_table(cell, expected):
    plain = store.plain_cell(cell)
    assert plain == expected and type(plain) is type(expected)
    json.dumps(plain, allow_nan=False)


def test_heads_survive_json():
    heads = (Head("texture", ("felt", "silk"), np.array([0, 0, 1])), Head("speed", ("1", "2"), np.arange(3)))
    again = store.heads_of(json.loads(json.dumps(store.heads_document(heads))))
    assert repr(again) == repr(heads)
