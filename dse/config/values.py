"""A plain value against a field's type annotation and `Rule`: one sentence per mistake.

Understood annotations: bool, int, float, str, None, Any, Literal, unions, tuples, lists, mappings
with text keys, and dataclasses (whose own fields are checked in turn).
"""

from __future__ import annotations

import dataclasses
import math
import types
import typing
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, Literal, Union, get_args, get_origin

from dse.config.faults import known_names
from dse.config.yaml_lines import Path
from dse.registry import Rule, rule_of

Report = Callable[[Path, str], None]
INVALID: Any = object()
_SCALARS = {bool: "true or false", int: "an integer", float: "a number", str: "text", type(None): "null"}
_LISTS = (tuple, list, Sequence)
_LONGEST_ECHO = 60


def dotted(path: Path) -> str:
    """Return `model.hidden[1]` for ('model', 'hidden', 1)."""
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def echo(value: Any) -> str:
    """Return a value as the user wrote it, shortened."""
    if value is None or isinstance(value, bool):
        return str(value).lower().replace("none", "null")
    text = repr(list(value) if isinstance(value, tuple) else value)
    return text if len(text) <= _LONGEST_ECHO else f"{text[: _LONGEST_ECHO - 3]}..."


def is_list(hint: Any) -> bool:
    """Return whether a field of this type can hold nothing but lists (or null)."""
    origin = get_origin(hint) or hint
    if origin in (Union, types.UnionType):
        return all(is_list(option) for option in get_args(hint) if option is not type(None))
    return isinstance(origin, type) and origin in _LISTS


def number_type(hint: Any) -> type | None:
    """Return float or int if a field (or the elements of its list) can hold such a number, else None."""
    if hint in (int, float):
        return typing.cast(type, hint)
    found = {number_type(option) for option in get_args(hint) if option is not Ellipsis}
    return float if float in found else int if int in found else None


def wanted(hint: Any) -> str:
    """Return what a value must be, in words: 'an integer', 'a list of numbers'."""
    origin, args = get_origin(hint) or hint, get_args(hint)
    if origin is Literal:
        return "one of " + ", ".join(map(str, args))
    if origin in (Union, types.UnionType):
        return " or ".join(dict.fromkeys(wanted(option) for option in args))
    if is_list(hint):
        inner = [a for a in args if a is not Ellipsis]
        if not inner or inner[0] is Any:
            return "a list"
        plural = {bool: "of true or false", int: "of integers", float: "of numbers", str: "of texts"}
        return f"a list {plural.get(inner[0], f'({wanted(inner[0])})')}"
    if dataclasses.is_dataclass(origin) or (isinstance(origin, type) and issubclass(origin, Mapping)):
        return "a mapping"
    return _SCALARS.get(origin, "a value")


def bounds(rule: Rule) -> str:
    """Return the bounds of a rule in words, '' without bounds: '>= 1', 'in (0, 1]'."""
    if rule.low is not None and rule.high is not None:
        opening, closing = "(" if rule.low_open else "[", ")" if rule.high_open else "]"
        return f"in {opening}{rule.low:g}, {rule.high:g}{closing}"
    if rule.low is not None:
        return f"{'>' if rule.low_open else '>='} {rule.low:g}"
    if rule.high is not None:
        return f"{'<' if rule.high_open else '<='} {rule.high:g}"
    return ""


def read(value: Any, hint: Any, rule: Rule, path: Path, report: Report) -> Any:
    """Return the value in its field's type, or INVALID after reporting every mistake in it.

    Integers become floats in float fields, lists become tuples, and one scalar where a list is
    wanted becomes a list of one.
    """
    origin, args = get_origin(hint) or hint, get_args(hint)
    if hint is Any or hint is object:
        return _plain(value)
    if origin in (Union, types.UnionType):
        return _union(value, hint, rule, path, report)
    if origin is Literal:
        return _chosen(value, args, path, report)
    if is_list(hint):
        return _list(value, hint, rule, path, report)
    if dataclasses.is_dataclass(origin):
        found, good = read_fields(typing.cast(type, origin), value, path, report)
        return found if good else INVALID
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return _mapping(value, args[1] if args else Any, rule, path, report)
    return _scalar(value, hint, rule, path, report)


def read_fields(
    cls: type,
    value: Any,
    path: Path,
    report: Report,
    read_one: Callable[..., Any] = read,
    *,
    also: Collection[str] = (),
) -> tuple[dict[str, Any], bool]:
    """Return the keys of a dataclass as plain data, and whether all of it is right.

    Keys with a mistake are left out; absent ones have their default.

    Args:
        cls: dataclass whose init fields are the allowed keys.
        value: the mapping as written.
        path: where it stands.
        report: called with (path, sentence) for every mistake.
        read_one: reads one field's value; `read` unless axes are allowed in its place.
        also: further keys that somebody else reads.
    """
    result, good = read_given(cls, value, path, report, read_one, also=also)
    given = value if isinstance(value, dict) else {}
    for key, field in _fields(cls).items():
        if key in given:
            continue
        if field.default is not dataclasses.MISSING:
            result[key] = _plain(field.default)
        elif field.default_factory is not dataclasses.MISSING:
            result[key] = _plain(field.default_factory())
        else:
            doc = rule_of(field).doc
            if value is None or isinstance(value, dict):
                report(path, f"{dotted(path)}.{key} is required" + (f": {doc}" if doc else ""))
            good = False
    return {key: result[key] for key in _fields(cls) if key in result}, good


def read_given(
    cls: type,
    value: Any,
    path: Path,
    report: Report,
    read_one: Callable[..., Any] = read,
    *,
    also: Collection[str] = (),
) -> tuple[dict[str, Any], bool]:
    """Return those keys of a dataclass that are written, and whether all are right (see `read_fields`)."""
    name = dotted(path)
    if value is None:
        value = {}
    if not isinstance(value, dict):
        report(path, f"{name} must be a mapping of keys to values, got {echo(value)}")
        return {}, False
    hints = typing.get_type_hints(cls)
    known = _fields(cls)
    result: dict[str, Any] = {}
    good = True
    for key, given in value.items():
        if key in known:
            found = read_one(given, hints[key], rule_of(known[key]), (*path, key), report)
            good &= found is not INVALID
            result |= {} if found is INVALID else {key: found}
        elif key not in also:
            good = False
            report((*path, key), f"unknown key '{name}.{key}'; {known_names(key, [*known, *also])}")
    return result, good


def _fields(cls: type) -> dict[str, dataclasses.Field[Any]]:
    return {field.name: field for field in dataclasses.fields(cls) if field.init}


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: _plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, list | tuple):
        return tuple(_plain(element) for element in value)
    if isinstance(value, Mapping):
        return {str(key): _plain(element) for key, element in value.items()}
    return value


def _scalar(value: Any, hint: Any, rule: Rule, path: Path, report: Report) -> Any:
    name = dotted(path)
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if hint is float and is_number:
        value = float(value)
    if type(value) is not hint:
        report(path, f"{name} must be {wanted(hint)}, got {echo(value)}")
        return INVALID
    if isinstance(value, float) and not math.isfinite(value):
        report(path, f"{name} must be a finite number, got {echo(value)}")
        return INVALID
    if rule.choices:
        return _chosen(value, rule.choices, path, report)
    if is_number and not _within(value, rule):
        report(path, f"{name} must be {bounds(rule)}, got {echo(value)}")
        return INVALID
    return value


def _within(value: float, rule: Rule) -> bool:
    if rule.low is not None and (value < rule.low or (rule.low_open and value == rule.low)):
        return False
    return not (rule.high is not None and (value > rule.high or (rule.high_open and value == rule.high)))


def _chosen(value: Any, choices: Sequence[Any], path: Path, report: Report) -> Any:
    if any(type(value) is type(choice) and value == choice for choice in choices):
        return value
    report(path, f"unknown {dotted(path)} {echo(value)}; {known_names(str(value), map(str, choices))}")
    return INVALID


def _union(value: Any, hint: Any, rule: Rule, path: Path, report: Report) -> Any:
    options = get_args(hint)
    if value is None and type(None) in options:
        return None
    options = tuple(option for option in options if option is not type(None))
    if len(options) == 1:
        return read(value, options[0], rule, path, report)
    attempts: list[list[tuple[Path, str]]] = []
    for option in options:
        faults: list[tuple[Path, str]] = []
        found = read(value, option, rule, path, lambda where, text, into=faults: into.append((where, text)))  # type: ignore[misc]
        if not faults:
            return found
        attempts.append(faults)
    # The option that fits the shape of what was written names the mistake best.
    fitting = [faults for option, faults in zip(options, attempts, strict=True) if _same_shape(value, option)]
    if len(fitting) == 1:
        for where, text in fitting[0]:
            report(where, text)
    else:
        report(path, f"{dotted(path)} must be {wanted(hint)}, got {echo(value)}")
    return INVALID


def _same_shape(value: Any, hint: Any) -> bool:
    if isinstance(value, list | tuple):
        return is_list(hint)
    if isinstance(value, dict):
        return wanted(hint) == "a mapping"
    if isinstance(value, str):
        return hint is str or get_origin(hint) is Literal
    return hint is type(value)


def _list(value: Any, hint: Any, rule: Rule, path: Path, report: Report) -> Any:
    args = [argument for argument in get_args(hint) if argument is not Ellipsis]
    if isinstance(value, str | bool | int | float):
        value = [value]  # `hidden: 200` is short for `hidden: [200]`
    if not isinstance(value, list | tuple):
        report(path, f"{dotted(path)} must be {wanted(hint)}, got {echo(value)}")
        return INVALID
    fixed_length = get_origin(hint) is tuple and Ellipsis not in get_args(hint)
    if fixed_length and len(value) != len(args):
        report(path, f"{dotted(path)} must have {len(args)} elements, got {len(value)}")
        return INVALID
    hints = args if fixed_length else [args[0] if args else Any] * len(value)
    found = [read(x, h, rule, (*path, i), report) for i, (x, h) in enumerate(zip(value, hints, strict=True))]
    return INVALID if any(element is INVALID for element in found) else tuple(found)


def _mapping(value: Any, hint: Any, rule: Rule, path: Path, report: Report) -> Any:
    if value is None:
        value = {}
    if not isinstance(value, dict):
        report(path, f"{dotted(path)} must be a mapping, got {echo(value)}")
        return INVALID
    found = {key: read(element, hint, rule, (*path, key), report) for key, element in value.items()}
    return INVALID if any(element is INVALID for element in found.values()) else found
