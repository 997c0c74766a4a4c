import dataclasses

import pytest

from dse.base.registry import rule_of
from dse.config import parts
from dse.config.schema import json_schema
from dse.config.settings import Preprocessing, Training
from dse.config.values import dotted


def read(raw):
    faults = []
    found = parts.settings(
        "preprocessing", Preprocessing, raw, lambda path, text: faults.append(f"{dotted(path)}: {text}")
    )
    return found, faults


@pytest.mark.parametrize(
    ("key", "value", "meant"),
    [
        ("pool", 4, 4),
        ("pool", [4, 2], (4, 2)),
        ("stride", None, None),
        ("stride", [3, 1], (3, 1)),
        ("padding", 0, 0),
        ("crop", "pins", "pins"),
        ("crop", [2, 3, 10, 12], (2, 3, 10, 12)),
        ("crop", None, None),
        ("time_ms", [0, 500], (0.0, 500.0)),
        ("rate_floor_hz", 2, 2.0),
        ("exceeds", True, True),
        ("every_event", True, True),
        ("pool_threshold", 254, 254),
        ("polarity", "ignore_on", "ignore_on"),
    ],
)
def test_values_as_they_are_written(key, value, meant):
    found, faults = read({"bin_ms": 1, key: value})
    assert not faults
    assert getattr(Preprocessing(**found.values), key) == meant


@pytest.mark.parametrize(
    ("key", "axis", "values"),
    [
        ("bin_ms", {"choice": [1, 10]}, (1.0, 10.0)),
        ("pool", {"range": [1, 3]}, (1, 2, 3)),
        ("pool", {"choice": [2, [4, 2]]}, (2, (4, 2))),
        ("stride", {"choice": [None, 2, [1, 2]]}, (None, 2, (1, 2))),
        ("padding", {"choice": [0, [1, 0]]}, (0, (1, 0))),
        ("pool_threshold", {"range": [1, 5], "step": 2}, (1, 3, 5)),
        ("exceeds", {"choice": [False, True]}, (False, True)),
        ("every_event", {"choice": [False, True]}, (False, True)),
        ("polarity", {"choice": ["split", "merge"]}, ("split", "merge")),
        ("crop", {"choice": [None, "pins", [0, 0, 8, 8]]}, (None, "pins", (0, 0, 8, 8))),
        ("time_ms", {"choice": [[0, 100], [0, 200]]}, ((0.0, 100.0), (0.0, 200.0))),
        ("rate_floor_hz", {"range": [0, 4], "step": 2}, (0.0, 2.0, 4.0)),
    ],
)
def test_every_key_may_be_an_axis(key, axis, values):
    raw = {"bin_ms": 1, "pool": 4} | {key: axis}
    found, faults = read(raw)
    assert not faults
    assert found.axes[f"preprocessing.{key}"].values == values


def test_no_key_is_left_out_above():
    (mark,) = test_every_key_may_be_an_axis.pytestmark
    tried = {key for key, *_ in mark.args[1]}
    assert tried == {field.name for field in dataclasses.fields(Preprocessing)}
    assert all(rule_of(field).axis and rule_of(field).doc for field in dataclasses.fields(Preprocessing))
    assert tried == set(json_schema()["properties"]["preprocessing"]["properties"])


@pytest.mark.parametrize(
    ("raw", "fault"),
    [
        ({"pool": 0}, "preprocessing.pool: preprocessing.pool must be >= 1, got 0"),
        ({"pool": [4, 0]}, "preprocessing.pool[1]: preprocessing.pool[1] must be >= 1, got 0"),
        ({"pool": [1, 2, 3]}, "preprocessing.pool: preprocessing.pool must have 2 elements, got 3"),
        ({"pool": 2.5}, "preprocessing.pool: preprocessing.pool must be an integer or a list of integers"),
        ({"crop": "pin"}, "preprocessing.crop: unknown preprocessing.crop 'pin'; known: pins. Did you mean"),
        ({"pool_threshold": 255}, "preprocessing.pool_threshold: preprocessing.pool_threshold must be in"),
        ({"padding": 1}, "preprocessing.padding: preprocessing.padding must be smaller than pool (1), so"),
        ({"pool": [4, 2], "padding": {"choice": [0, 2]}}, "preprocessing.padding: preprocessing.padding"),
        ({"crop": [0, 0, 5, 0]}, "preprocessing.crop: preprocessing.crop must be [x, y, width, height] of"),
        ({"time_ms": [5, 5]}, "preprocessing.time_ms: preprocessing.time_ms must end at least 0.001 ms"),
        ({"polarity": "both"}, "preprocessing.polarity: unknown preprocessing.polarity 'both'; known"),
    ],
)
def test_faults_are_named(raw, fault):
    found, faults = read({"bin_ms": 1} | raw)
    assert not found.good and len(faults) == 1 and faults[0].startswith(fault)


def test_a_bin_is_whole_microseconds():
    assert Preprocessing(bin_ms=0.0314).bin_us == 31
    assert Preprocessing(bin_ms=10).bin_us == 10_000


@pytest.mark.parametrize(
    ("keys", "fault"),
    [
        ({"dilation": [1.1, 0.9], "dilation_keeps_label": True}, "dilation must be in increasing order"),
        ({"dilation": [0.9, 1.1]}, "dilation changes speeds and durations: it needs dilation_keeps_label"),
        ({"dilation": {"choice": [[1, 1], [0.9, 1.1]]}}, "dilation changes speeds and durations"),
        ({"dilation": [0.1, 1], "dilation_keeps_label": True}, "dilation[0] must be in [0.5, 2], got 0.1"),
        ({"event_dropout": 1}, "event_dropout must be in [0, 1), got 1.0"),
        ({"channel_shift": -1}, "channel_shift must be >= 0, got -1"),
        ({"blend": 1.5}, "blend must be in [0, 1], got 1.5"),
    ],
)
def test_changes_of_training_windows_that_cannot_be(keys, fault):
    faults = []
    parts.settings("training", Training, keys, lambda path, text: faults.append(f"{dotted(path)}: {text}"))
    (found,) = faults
    assert found.startswith(f"training.{next(iter(keys))}") and f"training.{fault}" in found


def test_training_windows_change_only_where_a_key_says_so():
    assert Training().augmentation == () == Training(dilation_keeps_label=True).augmentation
    assert Training(blend=0.5).augmentation != Training(event_dropout=0.5).augmentation != ()
