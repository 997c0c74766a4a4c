from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.base.registry import Rule
from dse.config.axes import Axis, stepped
from dse.config.parts import read_or_axis
from dse.config.values import INVALID

PATH = ("model", "key")


def axis_of(raw, hint=float, **rule):
    found = read_or_axis(raw, hint, Rule("", **rule), PATH, lambda path, text: pytest.fail(text))
    assert isinstance(found, Axis)
    return found


def faults_of(raw, hint=float, **rule):
    found = []
    assert read_or_axis(raw, hint, Rule("", **rule), PATH, lambda _, text: found.append(text)) is INVALID
    return found


@pytest.mark.parametrize(
    ("raw", "hint", "values"),
    [
        ({"choice": [3, 1, 2]}, int, (3, 1, 2)),
        ({"choice": [1, 2.5]}, float, (1.0, 2.5)),
        ({"choice": ["b", "a"]}, str, ("b", "a")),
        ({"choice": [True, False]}, bool, (True, False)),
        ({"choice": [None, 4]}, int | None, (None, 4)),
        ({"range": [10, 30], "step": 10}, int, (10, 20, 30)),
        ({"range": [10, 35], "step": 10}, int, (10, 20, 30)),
        ({"range": [2, 5]}, int, (2, 3, 4, 5)),
        ({"range": [0.2, 0.5], "step": 0.1}, float, (0.2, 0.3, 0.4, 0.5)),
        ({"range": [0, 1], "step": 1}, float, (0.0, 1.0)),
        ({"range": [1, 4], "step": 2}, tuple[int, ...], (1, 3)),
        ({"choice": [[50], [100]]}, tuple[int, ...], (50, 100)),
        ({"choice": [50, [100]]}, tuple[int, ...], (50, 100)),
        ({"choice": [[50], [100, 20]]}, tuple[int, ...], ((50,), (100, 20))),
        ({"range": [1, 3], "step": 1}, Any, (1, 2, 3)),
    ],
)
def test_values(raw, hint, values):
    found = axis_of(raw, hint).values
    assert found == values
    assert [type(value) for value in found or ()] == [type(value) for value in values]


def test_a_range_without_step_has_no_values():
    axis = axis_of({"range": [0.1, 10], "log": True})
    assert axis == Axis("model.key", None, 0.1, 10.0, None, True)
    assert axis.contains(0.1) and axis.contains(3) and not axis.contains(11.0) and not axis.contains(True)
    whole = axis_of({"range": [1, 1000], "log": True}, int)
    assert whole.values is None and whole.is_int
    assert whole.contains(7) and not whole.contains(7.5)


@pytest.mark.parametrize(
    ("raw", "hint", "rule", "message"),
    [
        ({"range": [5, 1], "step": 1}, int, {}, "model.key.range must be in increasing order, got [5, 1]"),
        ({"range": [1, 1]}, float, {}, "model.key.range must be in increasing order, got [1.0, 1.0]"),
        ({"range": [1]}, float, {}, "model.key.range must be two numbers [low, high], got [1]"),
        ({"range": ["a", 2]}, float, {}, "model.key.range must be two numbers [low, high], got ['a', 2]"),
        ({"range": 3}, float, {}, "model.key.range must be two numbers [low, high], got 3"),
        ({"range": [0, 2]}, float, {"high": 1}, "model.key.range[1] must be <= 1, got 2.0"),
        ({"range": [0.5, 2]}, int, {}, "model.key.range[0] must be an integer, got 0.5"),
        ({"range": [1, 2]}, str, {}, "model.key is not a number and must be a choice, got a range"),
        ({"range": [0, 1], "log": True}, float, {}, "model.key.range must start above 0 for log: true, got"),
        ({"range": [1, 2], "log": True, "step": 1}, float, {}, "model.key has log: true and cannot also"),
        ({"range": [1, 2], "log": 1}, float, {}, "model.key.log must be true or false, got 1"),
        ({"range": [1, 2], "step": 0}, float, {}, "model.key.step must be a number > 0, got 0"),
        ({"range": [1, 2], "step": -1}, float, {}, "model.key.step must be a number > 0, got -1"),
        ({"range": [1, 9], "step": 0.5}, int, {}, "model.key.step must be an integer > 0, got 0.5"),
        ({"range": [1, 2], "stpe": 1}, float, {}, "unknown key 'model.key.stpe'; known: choice, range"),
        ({"range": [0, 1], "step": 1e-9}, float, {}, "model.key.range has more than 100000 values; use a"),
        ({"choice": []}, int, {}, "model.key.choice must be a list of one or more values, got []"),
        ({"choice": 3}, int, {}, "model.key.choice must be a list of one or more values, got 3"),
        ({"choice": [1, 2, 1]}, int, {}, "model.key.choice has 1 twice"),
        ({"choice": [1, 1.0]}, float, {}, "model.key.choice has 1.0 twice"),
        ({"choice": [1, 0]}, int, {"low": 1}, "model.key.choice[1] must be >= 1, got 0"),
        ({"choice": [[1], [2, 0]]}, tuple[int, ...], {"low": 1}, "model.key.choice[1][1] must be >= 1, got"),
        ({"choice": ["fats"]}, str, {"choices": ("fast",)}, "unknown model.key.choice[0] 'fats'; known"),
        ({"choice": [1, 2]}, int, {"axis": False}, "model.key cannot be an axis; it must be an integer"),
    ],
)
def test_one_sentence_per_mistake(raw, hint, rule, message):
    (found,) = faults_of(raw, hint, **rule)
    assert found.startswith(message)


def test_a_choice_has_no_step():
    found = []
    read_or_axis({"choice": [1], "step": 1}, int, Rule(""), PATH, lambda _, text: found.append(text))
    assert found == ["model.key has a choice and cannot also have 'step'"]


def test_every_wrong_value_of_a_choice_is_named():
    assert len(faults_of({"choice": [0, 1, "x", -1]}, int, low=1)) == 3


def test_one_and_true_are_different_values():
    assert axis_of({"choice": [1, True]}, Any).values == (1, True)


@given(st.integers(-50, 50), st.integers(1, 60), st.sampled_from([0.05, 0.1, 0.25, 0.3]))
def test_steps_are_free_of_rounding_creep(first, count, step):
    low = round(first * step, 6)
    values = stepped(low, round(low + count * step, 6), step)
    assert len(values) == count + 1
    assert list(values) == [float(f"{low + k * step:.6f}") for k in range(count + 1)]


@pytest.mark.parametrize(
    "raw",
    [
        {"choice": [1.0, 3.0]},
        {"range": [0.5, 1.0], "step": 0.25},
        {"range": [0.5, 1.0]},
        {"range": [0.5, 1.0], "log": True},
    ],
)
def test_an_axis_is_written_as_it_was_read(raw):
    assert axis_of(raw).to_plain() == raw
    assert axis_of(axis_of(raw).to_plain()) == axis_of(raw)
