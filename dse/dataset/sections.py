"""Sections of a resolved design -> the dataclasses that they configure."""

from __future__ import annotations

import contextlib
import dataclasses
import types
import typing
from collections.abc import Iterator, Mapping
from typing import Any, TypeVar

from dse import registry
from dse.recordings import RecordingError

T = TypeVar("T")
Resolved = Mapping[str, Any]


def component(name: str, keys: Mapping[str, Any]) -> Any:
    """Return the registered component of a section of which `kind` names the component.

    Raises:
        RecordingError: no such component, or keys that it does not have.
    """
    known = registry.known(name)
    kind = keys.get("kind")
    if kind not in known:
        raise RecordingError(f"{name} has no component '{kind}'; known: {', '.join(known)}")
    return section(known[kind], {key: value for key, value in keys.items() if key != "kind"})


@contextlib.contextmanager
def refusals() -> Iterator[None]:
    """Turn what an encoder refuses into a fault of the recordings."""
    try:
        yield
    except RecordingError:
        raise
    except ValueError as error:
        raise RecordingError(str(error)) from None


def section(cls: type[T], keys: Mapping[str, Any] | None) -> T:
    """Return a dataclass made of plain values: lists become tuples, mappings the dataclasses of their fields.

    Raises:
        RecordingError: keys that it does not have, or required ones absent.
    """
    hints = typing.get_type_hints(cls)
    values = {key: _value(hints.get(key), value) for key, value in (keys or {}).items()}
    try:
        return cls(**values)
    except TypeError as error:
        raise RecordingError(str(error).replace(f"{cls.__name__}.__init__()", cls.__name__)) from None


def _value(hint: Any, value: Any) -> Any:
    if isinstance(value, list | tuple):
        return tuple(_value(None, element) for element in value)
    if isinstance(value, Mapping):
        options = typing.get_args(hint) if isinstance(hint, types.UnionType) else (hint,)
        for option in options:
            if dataclasses.is_dataclass(option) and isinstance(option, type):
                return section(option, value)
    return value
