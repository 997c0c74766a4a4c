"""YAML name -> component. A component is a frozen dataclass; its fields are its YAML keys.

Adding one is adding one file to its package: the decorator gives the YAML name, `param` gives each
key its unit, bounds and meaning, and `dse describe` prints them.
"""

from __future__ import annotations

import dataclasses
import importlib
import pkgutil
from collections.abc import Callable
from typing import Any, TypeVar

T = TypeVar("T")
_components: dict[str, dict[str, type]] = {}


@dataclasses.dataclass(frozen=True)
class Rule:
    """What a value must be: bounds, choices, unit and meaning of one key."""

    doc: str
    unit: str = ""
    low: float | None = None
    high: float | None = None
    low_open: bool = False
    high_open: bool = False
    choices: tuple[Any, ...] = ()
    axis: bool = True


def param(default: Any = dataclasses.MISSING, **rule: Any) -> Any:
    """Declare a dataclass field with its `Rule` (keywords of Rule); without a default it is required."""
    return dataclasses.field(default=default, metadata={"rule": Rule(**rule)})


def rule_of(field: dataclasses.Field[Any]) -> Rule:
    """Return the rule of a component's field."""
    found = field.metadata.get("rule")
    return found if isinstance(found, Rule) else Rule(doc="")


def register(section: str, name: str) -> Callable[[type[T]], type[T]]:
    """Register a frozen dataclass under a YAML section and name.

    Raises:
        ValueError: the name is taken.
        TypeError: the class is no frozen dataclass.
    """

    def decorate(cls: type[T]) -> type[T]:
        if not dataclasses.is_dataclass(cls) or not cls.__dataclass_params__.frozen:  # type: ignore[attr-defined]
            raise TypeError(f"{cls.__name__} must be a frozen dataclass")
        known = _components.setdefault(section, {})
        if name in known and known[name].__qualname__ != cls.__qualname__:
            raise ValueError(f"{section} '{name}' is already registered by {known[name].__module__}")
        known[name] = cls
        return cls

    return decorate


def known(section: str) -> dict[str, type]:
    """Return the components of a section by name, importing every module of its package `dse.<section>`."""
    package = importlib.import_module(f"dse.{section}")
    for module in pkgutil.walk_packages(package.__path__, f"dse.{section}."):
        importlib.import_module(module.name)
    return dict(sorted(_components.get(section, {}).items()))
