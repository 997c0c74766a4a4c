from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import pytest

from dse.base.registry import Rule, param
from dse.config.values import bounds, dotted, expected, read_fields


@dataclass(frozen=True)
class Inner:
    column: str
    scale: float = 1.0


@dataclass(frozen=True)
class Toy:
    count: int = param(3, doc="how many", low=1, high=9)
    share: float = param(0.5, doc="share", low=0, high=1, low_open=True)
    rate: float = param(1.0, doc="rate", low=0, unit="ms")
    name: str = param("x", doc="name")
    mode: str = param("fast", doc="mode", choices=("fast", "slow"))
    kind: Literal["a", "b"] = "a"
    on: bool = False
    sizes: tuple[int, ...] = param((1, 2), doc="sizes", low=1)
    pair: tuple[int, float] = (1, 2.0)
    maybe: int | None = param(None, doc="maybe", low=0)
    columns: Mapping[str, str] = field(default_factory=dict)
    any: Any = None
    target: str | Inner | tuple[str | Inner, ...] = "t"


@dataclass(frozen=True)
class Needy:
    file: str = param(doc="the file")


def faults_of(cls, raw):
    found = []
    read_fields(cls, raw, ("toy",), lambda path, text: found.append(f"{dotted(path)}: {text}"))
    return found


def values_of(raw):
    values, good = read_fields(Toy, raw, ("toy",), lambda path, text: pytest.fail(text))
    assert good
    return values


def test_defaults_are_filled_in():
    assert Toy(**values_of({})) == Toy()


def test_values_take_the_type_of_their_field():
    values = values_of({"rate": 2, "sizes": 7, "pair": [3, 4], "columns": {"a": "b"}, "any": [1, {"b": [2]}]})
    assert type(values["rate"]) is float
    assert values["sizes"] == (7,)
    assert values["pair"] == (3, 4.0)
    assert values["columns"] == {"a": "b"}
    assert values["any"] == (1, {"b": (2,)})


def test_unions_take_each_of_their_forms():
    inner = Inner("c", 2.0)
    assert values_of({"target": "speed"})["target"] == "speed"
    assert values_of({"target": {"column": "c", "scale": 2}})["target"] == inner
    assert values_of({"target": ["s", {"column": "c", "scale": 2}]})["target"] == ("s", inner)
    assert values_of({"maybe": None})["maybe"] is None
    assert values_of({"maybe": 0})["maybe"] == 0


@pytest.mark.parametrize(
    ("raw", "message"),
    [
        ({"count": 0}, "toy.count must be in [1, 9], got 0"),
        ({"count": 10}, "toy.count must be in [1, 9], got 10"),
        ({"count": 2.0}, "toy.count must be an integer, got 2.0"),
        ({"count": True}, "toy.count must be an integer, got true"),
        ({"count": None}, "toy.count must be an integer, got null"),
        ({"share": 0}, "toy.share must be in (0, 1], got 0.0"),
        ({"share": "half"}, "toy.share must be a number, got 'half'"),
        ({"share": float("nan")}, "toy.share must be a finite number, got nan"),
        ({"rate": float("inf")}, "toy.rate must be a finite number, got inf"),
        ({"rate": -0.2}, "toy.rate must be >= 0, got -0.2"),
        ({"name": 5}, "toy.name must be text, got 5"),
        ({"name": ["a"]}, "toy.name must be text, got ['a']"),
        ({"mode": "fsat"}, "unknown toy.mode 'fsat'; known: fast, slow. Did you mean 'fast'?"),
        ({"kind": "c"}, "unknown toy.kind 'c'; known: a, b"),
        ({"on": 1}, "toy.on must be true or false, got 1"),
        ({"sizes": "many"}, "toy.sizes[0] must be an integer, got 'many'"),
        ({"sizes": {"a": 1}}, "toy.sizes must be a list of integers, got {'a': 1}"),
        ({"sizes": [1, 0]}, "toy.sizes[1] must be >= 1, got 0"),
        ({"pair": [1]}, "toy.pair must have 2 elements, got 1"),
        ({"maybe": -1}, "toy.maybe must be >= 0, got -1"),
        ({"maybe": "x"}, "toy.maybe must be an integer, got 'x'"),
        ({"columns": {"a": 1}}, "toy.columns.a must be text, got 1"),
        ({"columns": ["a"]}, "toy.columns must be a mapping, got ['a']"),
        ({"target": {"colum": "c", "column": "d"}}, "unknown key 'toy.target.colum'; known: column, scale"),
        ({"target": ["a", 3]}, "toy.target[1] must be text or a mapping, got 3"),
        ({"cuont": 3}, "unknown key 'toy.cuont'; known: count, share, rate, name, mode, kind, on, sizes"),
        ([1], "toy must be a mapping of keys to values, got [1]"),
    ],
)
def test_one_sentence_per_mistake(raw, message):
    (found,) = faults_of(Toy, raw)
    assert found.split(": ", 1)[1].startswith(message)


def test_all_mistakes_are_found():
    assert len(faults_of(Toy, {"count": 0, "shar": 1, "mode": "x", "sizes": [0, -1], "on": "yes"})) == 6


def test_a_required_key_is_asked_for_with_its_meaning():
    assert faults_of(Needy, {}) == ["toy: toy.file is required: the file"]
    assert faults_of(Needy, None) == ["toy: toy.file is required: the file"]


def test_long_values_are_shortened():
    (message,) = faults_of(Toy, {"name": list(range(1000))})
    assert len(message) < 120


def test_words():
    assert bounds(Rule("", low=0)) == ">= 0"
    assert bounds(Rule("", high=2, high_open=True)) == "< 2"
    assert bounds(Rule("")) == ""
    assert expected(tuple[float, ...]) == "a list of numbers"
    assert expected(tuple[tuple[int, ...], ...]) == "a list (a list of integers)"
    assert expected(int | None) == "an integer or null"
