"""What all contracts have in common: a frozen dataclass with documented keys, and equality bit for bit."""

from __future__ import annotations

import copy
import dataclasses
import pickle
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import numpy as np

from dse.base.registry import rule_of

T = TypeVar("T")


def expect(condition: object, text: str) -> None:
    """Raise an AssertionError with a sentence unless a condition holds."""
    if not condition:
        raise AssertionError(text)


def expect_component(component: object) -> str:
    """Return the name of a component's class, after checking what every component is.

    It is a frozen dataclass whose keys say what they mean, and pickles.
    """
    cls: Any = type(component)
    name: str = cls.__name__
    parameters: Any = getattr(cls, "__dataclass_params__", None)
    expect(parameters is not None and parameters.frozen, f"{name} must be a frozen dataclass")
    for field in dataclasses.fields(cls):
        expect(rule_of(field).doc or not field.init, f"key {name}.{field.name} must say what it means")
    expect((cls.__doc__ or "").strip(), f"{name} must have a docstring: `dse describe` prints it")
    expect(pickle.dumps(component), f"{name} must pickle: workers get copies")
    return name


def same(first: Any, second: Any) -> bool:
    """Return whether two values are equal bit for bit: arrays, records, mappings and lists of them."""
    if isinstance(first, np.ndarray) or isinstance(second, np.ndarray):
        a, b = np.asarray(first), np.asarray(second)
        return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
    if type(first) is not type(second):
        return False
    if dataclasses.is_dataclass(first) and not isinstance(first, type):
        return all(same(getattr(first, f.name), getattr(second, f.name)) for f in dataclasses.fields(first))
    if isinstance(first, Mapping):
        return first.keys() == second.keys() and all(same(value, second[key]) for key, value in first.items())
    if isinstance(first, list | tuple):
        return len(first) == len(second) and all(map(same, first, second))
    return bool(first == second or (first != first and second != second))


def unchanged(what: str, function: Callable[..., T], *arguments: Any) -> T:
    """Return what a function returns, after checking that it leaves its arguments as they are."""
    before = copy.deepcopy(arguments)
    found = function(*arguments)
    expect(same(arguments, before), f"what {what} is given must not be changed")
    return found


def pure(what: str, function: Callable[..., T], *arguments: Any) -> T:
    """Return the same after checking that a second call returns it too."""
    found = unchanged(what, function, *arguments)
    expect(same(found, function(*arguments)), f"{what} must return the same twice")
    return found
