"""Plain values -> typed, frozen objects, with one sentence per mistake: the reader of every file of a user.

`read_object` makes a dataclass of a mapping; `plain` is the way back.

Understood annotations: bool, int, float, str, None, Any, Literal, unions, tuples, lists, mappings
with text keys, and dataclasses (whose own fields are checked in turn).
"""

from __future__ import annotations

import dataclasses
import functools
import math
import types
import typing
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, Literal, TypeVar, Union, cast, get_args, get_origin

import numpy as np

from dse.base import registry
from dse.base.registry import Rule, rule_of
from dse.config.faults import known_names
from dse.config.yaml_lines import Path, Raw

T = TypeVar("T")
Values = dict[str, Any]
"""Key -> value, checked against the annotation of its field, which is known only when the program runs."""
Hint = object
"""The annotation of a field of a dataclass: a type, or a form such as `tuple[int, ...]`."""
Report = Callable[[Path, str], None]
"""Called with (path, sentence) for every mistake; `Document.fault` makes a fault with file and line of it."""
ReadOne = Callable[[Raw, Hint, Rule, Path, Report], Any]
INVALID: Any = object()
_SCALARS: dict[object, str] = {
    bool: "true or false",
    int: "an integer",
    float: "a number",
    str: "text",
    type(None): "null",
}
_LISTS = (tuple, list, Sequence)
_LONGEST_ECHO = 60


def dotted(path: Path) -> str:
    """Return `model.hidden[1]` for ('model', 'hidden', 1)."""
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def echo(value: Raw) -> str:
    """Return a value as the user wrote it, shortened."""
    if value is None or isinstance(value, bool):
        return str(value).lower().replace("none", "null")
    text = repr(list(value) if isinstance(value, tuple) else value)
    return text if len(text) <= _LONGEST_ECHO else f"{text[: _LONGEST_ECHO - 3]}..."


def is_list(hint: Hint) -> bool:
    """Return whether a field of this type can hold nothing but lists (or null)."""
    origin = get_origin(hint) or hint
    if origin in (Union, types.UnionType):
        return all(is_list(option) for option in get_args(hint) if option is not type(None))
    return isinstance(origin, type) and origin in _LISTS


def number_type(hint: Hint) -> type | None:
    """Return float or int if a field (or the elements of its list) can hold such a number, else None."""
    if hint in (int, float):
        return cast(type, hint)
    numbers = {number_type(option) for option in get_args(hint) if option is not Ellipsis}
    return float if float in numbers else int if int in numbers else None


def expected(hint: Hint) -> str:
    """Return what a value must be, in words: 'an integer', 'a list of numbers'."""
    origin, args = get_origin(hint) or hint, get_args(hint)
    if origin is Literal:
        return "one of " + ", ".join(map(str, args))
    if origin in (Union, types.UnionType):
        return " or ".join(dict.fromkeys(expected(option) for option in args))
    if is_list(hint):
        inner = [a for a in args if a is not Ellipsis]
        if not inner or inner[0] in (Any, object):
            return "a list"
        plural = {bool: "of true or false", int: "of integers", float: "of numbers", str: "of texts"}
        return f"a list {plural.get(inner[0], f'({expected(inner[0])})')}"
    if dataclasses.is_dataclass(origin) or (isinstance(origin, type) and issubclass(origin, Mapping)):
        return "a mapping"
    return _SCALARS.get(origin, "a value")


def bounds(rule: Rule) -> str:
    """Return the bounds of a rule in words, '' without bounds: '>= 1', 'in (0, 1]'."""
    if rule.low is not None and rule.high is not None:
        opening, closing = "(" if rule.low_open else "[", ")" if rule.high_open else "]"
        return f"in {opening}{rule.low:.10g}, {rule.high:.10g}{closing}"
    if rule.low is not None:
        return f"{'>' if rule.low_open else '>='} {rule.low:g}"
    if rule.high is not None:
        return f"{'<' if rule.high_open else '<='} {rule.high:g}"
    return ""


def read(value: Raw, hint: Hint, rule: Rule, path: Path, report: Report) -> Any:
    """Return the value in its field's type, or INVALID after reporting every mistake in it.

    Integers become floats in float fields, lists become tuples, and one scalar where a list is
    expected becomes a list of one.
    """
    origin, args = get_origin(hint) or hint, get_args(hint)
    if hint is Any or hint is object:
        return plain(value)
    if origin in (Union, types.UnionType):
        return _union(value, hint, rule, path, report)
    if origin is Literal:
        return _chosen(value, args, path, report)
    if is_list(hint):
        return _list(value, hint, rule, path, report)
    if dataclasses.is_dataclass(origin):
        instance = read_object(cast(type, origin), value, path, report)
        return INVALID if instance is None else instance
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return _mapping(value, args[1] if args else Any, rule, path, report)
    return _scalar(value, hint, rule, path, report)


@dataclasses.dataclass(frozen=True)
class Key:
    """One key of a mapping that a dataclass describes.

    hint: type annotation of its field.
    default: makes the value where the key is absent; None where it is required. INVALID: each of several
        components has a default of its own.
    others: rules of further components that have the key.
    """

    hint: Hint
    rule: Rule
    default: Callable[[], Any] | None
    others: tuple[Rule, ...] = ()


def keys_of(cls: type, written: Mapping[str, Raw] | None = None) -> dict[str, Key]:
    """Return the keys of a dataclass in the order of its fields.

    A field that holds a component (`Rule.component`) is a key that names the component, followed by the
    component's own keys; those of the default component where `written` names none that is known, and those
    of all that it names where it is an axis.

    Raises:
        ValueError: a component has a key that the dataclass or another of its components has too.
    """
    keys: dict[str, Key] = {}
    for name, field in _fields(cls).items():
        rule = rule_of(field)
        added = {name: Key(_hints(cls)[field.name], rule, _default(field))}
        if rule.component:
            components = registry.known(rule.component)
            default = functools.partial(str, rule.component_name) if rule.component_name else None
            added = {name: Key(str, dataclasses.replace(rule, choices=tuple(components)), default)}
            added |= _keys_of_any(name, components_named((written or {}).get(name), rule), written)
        if twice := sorted(added.keys() & keys.keys()):
            raise ValueError(f"{name} must not name a component with a key of {cls.__name__}, '{twice[0]}'")
        keys |= added
    return keys


def components_named(written: Raw, rule: Rule) -> dict[str, type]:
    """Return the components that a key names, by name: one, those of an axis, or by default the rule's."""
    named = written.get("choice") if isinstance(written, dict) else getattr(written, "values", written)
    names = named if isinstance(named, list | tuple) else [rule.component_name if named is None else named]
    known = registry.known(rule.component)
    return {name: known[name] for name in names if isinstance(name, str) and name in known}


def _keys_of_any(
    name: str, components: Mapping[str, type], written: Mapping[str, Raw] | None
) -> dict[str, Key]:
    """Return the keys of the components that a key names."""
    keys: dict[str, Key] = {}
    for component, cls in components.items():
        for own, key in keys_of(cls, written).items():
            before = keys.setdefault(own, key)
            if before is key:
                continue
            if before.hint != key.hint:
                kinds = " and ".join(components)
                raise ValueError(
                    f"{name} must not be a choice of {kinds}: '{own}' must be {expected(key.hint)} in "
                    f"{component}, and {expected(before.hint)} elsewhere"
                )
            alike = before.default and key.default and before.default() == key.default()
            keys[own] = dataclasses.replace(
                before,
                default=before.default if alike else lambda: INVALID,
                others=before.others if key.rule == before.rule else (*before.others, key.rule),
            )
    return keys


def read_object(
    cls: type[T],
    value: Raw,
    path: Path,
    report: Report,
    read_one: ReadOne = read,
    *,
    also: Collection[str] = (),
) -> T | None:
    """Return the dataclass that a mapping describes; None after reporting every mistake in it.

    The mapping's keys are the init fields of the dataclass, their annotations and rules (`registry.param`)
    say what a value must be. A key that the dataclass does not have is a mistake, and the report names the
    key that it may stand for; so is a required key that is absent, and whatever the dataclass itself refuses
    with a ValueError, whose sentence begins with the key that it is about. Its mapping `gone` says what to
    write in place of a key that it once had.

    Args:
        cls: the dataclass.
        value: the mapping as written; None stands for an empty one.
        path: keys that lead to the mapping; () is the whole document.
        report: of every mistake.
        read_one: reads one field's value; `parts.read_fixed` refuses an axis in its place by name.
        also: further keys, which somebody else reads.
    """
    values, good = read_fields(cls, value, path, report, read_one, also=also)
    try:
        return construct(cls, values) if good else None
    except ValueError as error:
        report(*blamed(str(error), values, path))
        return None


def construct(cls: type[T], values: Values) -> T:
    """Return the dataclass of the values of `read_fields`; lists and mappings of an axis are read here."""
    fields: Values = {}
    described: type = cls
    for name, field in _fields(described).items():
        if name not in values:
            continue
        rule, value = rule_of(field), values[name]
        if rule.component:
            component = registry.known(rule.component)[value]
            own = (key for key in keys_of(component, values) if key in values)
            fields[field.name] = construct(component, {key: values[key] for key in own})
        elif _holds_dataclass(hint := _hints(described)[field.name]):
            fields[field.name] = read(plain(value), hint, rule, (name,), refuse)
        else:
            fields[field.name] = value
    return cls(**fields)


def blamed(message: str, values: Collection[str], path: Path) -> tuple[Path, str]:
    """Return the path and the text of an error that a class raises about its values.

    Args:
        message: a sentence that begins with the key that it is about, alone or after the section's name.
        values: the keys of the class.
        path: keys that lead to the class.
    """
    name = dotted(path)
    section = str(path[0]) if path else ""
    text = message
    for prefix in dict.fromkeys((name, section)):
        text = text.removeprefix(f"{prefix}.")
    key = text.split(" ", 1)[0]
    if key in values:
        return (*path, key), f"{dotted((*path, key))}{text.removeprefix(key)}"
    return path, message if not name or message.startswith(section) else f"{name}: {message}"


def read_fields(
    cls: type,
    value: Raw,
    path: Path,
    report: Report,
    read_one: ReadOne = read,
    *,
    also: Collection[str] = (),
    has_defaults: bool = True,
) -> tuple[Values, bool]:
    """Return the keys of a dataclass with their values, and whether all of it is right.

    Keys with a mistake are left out; absent ones have their default, unless only what is written is asked for
    (`has_defaults`). `construct` makes the dataclass of them (`read_object` does both). Other arguments as in
    `read_object`.
    """
    if not isinstance(value, dict | None):
        report(path, f"{dotted(path) or 'the file'} must be a mapping of keys to values, got {echo(value)}")
        return {}, False
    written = value or {}
    try:
        keys = keys_of(cls, written)
    except ValueError as error:
        report(*blamed(str(error), _fields(cls), path))
        return {}, False
    result: Values = {}
    good = True
    for name, raw in written.items():
        if name in keys:
            key = keys[name]
            one = read_one(raw, key.hint, key.rule, (*path, name), report)
            for rule in key.others if one is not INVALID else ():
                one = one if read_one(raw, key.hint, rule, (*path, name), report) is not INVALID else INVALID
            good &= one is not INVALID
            result |= {} if one is INVALID else {name: one}
        elif name not in also and name not in getattr(cls, "ignored", ()):
            gone = getattr(cls, "gone", {}).get(name)
            if gone and raw is None:
                continue  # as a study of an earlier version has it
            good = False
            hint = gone or known_names(name, [*keys, *also])
            report((*path, name), f"unknown key '{dotted((*path, name))}'; {hint}")
    if not has_defaults:
        return result, good
    keys = keys if good else keys_of(cls)
    for name, key in keys.items():
        if name in written:
            continue
        if key.default is None:
            good = False
            doc = f": {key.rule.doc}" if key.rule.doc else ""
            report(path, f"{dotted((*path, name))} is required{doc}")
        elif (default := key.default()) is not INVALID:
            result[name] = default
    return {name: result[name] for name in keys if name in result}, good


def plain(value: Raw) -> Any:
    """Return a value as plain data: dataclasses as mappings, lists as tuples, numbers of numpy as Python's.

    A component in a field is its name, with its own keys beside it, as it is written in YAML.
    """
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        keys: dict[str, Raw] = {}
        for name, field in _fields(type(value)).items():
            inner, section = getattr(value, field.name), rule_of(field).component
            keys |= (
                {name: registry.name_of(section, inner), **plain(inner)} if section else {name: plain(inner)}
            )
        return keys
    if isinstance(value, list | tuple):
        return tuple(plain(element) for element in value)
    if isinstance(value, Mapping):
        return {str(key): plain(element) for key, element in value.items()}
    return value.item() if isinstance(value, np.generic) else value


@functools.cache
def _fields(cls: type) -> dict[str, dataclasses.Field[Any]]:
    """Return key -> field."""
    return {field.name: field for field in dataclasses.fields(cls) if field.init}


@functools.cache
def _hints(cls: type) -> dict[str, Hint]:
    return typing.get_type_hints(cls)


def _default(field: dataclasses.Field[Any]) -> Callable[[], Any] | None:
    if field.default is not dataclasses.MISSING:
        return lambda: field.default
    return None if field.default_factory is dataclasses.MISSING else field.default_factory


def _holds_dataclass(hint: Hint) -> bool:
    return dataclasses.is_dataclass(hint) or any(map(_holds_dataclass, get_args(hint)))


def refuse(path: Path, text: str) -> None:
    """Raise a ValueError: a `Report` for values that are right unless a caller is wrong."""
    raise ValueError(text)


def _scalar(value: Raw, hint: Hint, rule: Rule, path: Path, report: Report) -> Any:
    name = dotted(path)
    number = value if isinstance(value, int | float) and not isinstance(value, bool) else None
    if hint is float and number is not None:
        value = number = float(number)
    if type(value) is not hint:
        report(path, f"{name} must be {expected(hint)}, got {echo(value)}")
        return INVALID
    if isinstance(value, float) and not math.isfinite(value):
        report(path, f"{name} must be a finite number, got {echo(value)}")
        return INVALID
    if rule.choices:
        return _chosen(value, rule.choices, path, report)
    if number is not None and not _within(number, rule):
        report(path, f"{name} must be {bounds(rule)}, got {echo(value)}")
        return INVALID
    return value


def _within(value: float, rule: Rule) -> bool:
    if rule.low is not None and (value < rule.low or (rule.low_open and value == rule.low)):
        return False
    return not (rule.high is not None and (value > rule.high or (rule.high_open and value == rule.high)))


def _chosen(value: Raw, choices: Sequence[Any], path: Path, report: Report) -> Any:
    if any(type(value) is type(choice) and value == choice for choice in choices):
        return value
    report(path, f"unknown {dotted(path)} {echo(value)}; {known_names(str(value), map(str, choices))}")
    return INVALID


def _union(value: Raw, hint: Hint, rule: Rule, path: Path, report: Report) -> Any:
    options = get_args(hint)
    if value is None and type(None) in options:
        return None
    options = tuple(option for option in options if option is not type(None))
    if len(options) == 1:
        return read(value, options[0], rule, path, report)
    attempts: list[list[tuple[Path, str]]] = []
    for option in options:
        faults: list[tuple[Path, str]] = []
        result = read(value, option, rule, path, lambda where, text, into=faults: into.append((where, text)))  # type: ignore[misc]
        if not faults:
            return result
        attempts.append(faults)
    # The option that fits the shape of what was written names the mistake best.
    fitting = [faults for option, faults in zip(options, attempts, strict=True) if _same_shape(value, option)]
    if len(fitting) == 1:
        for where, text in fitting[0]:
            report(where, text)
    else:
        report(path, f"{dotted(path)} must be {expected(hint)}, got {echo(value)}")
    return INVALID


def _same_shape(value: Raw, hint: Hint) -> bool:
    if isinstance(value, list | tuple):
        return is_list(hint)
    if isinstance(value, dict):
        return expected(hint) == "a mapping"
    if isinstance(value, str):
        return hint is str or get_origin(hint) is Literal
    return hint is type(value)


def _list(value: Raw, hint: Hint, rule: Rule, path: Path, report: Report) -> Any:
    args = [argument for argument in get_args(hint) if argument is not Ellipsis]
    if isinstance(value, str | bool | int | float):
        value = [value]  # `hidden: 200` is short for `hidden: [200]`
    if not isinstance(value, list | tuple):
        report(path, f"{dotted(path)} must be {expected(hint)}, got {echo(value)}")
        return INVALID
    fixed_length = get_origin(hint) is tuple and Ellipsis not in get_args(hint)
    if fixed_length and len(value) != len(args):
        report(path, f"{dotted(path)} must have {len(args)} elements, got {len(value)}")
        return INVALID
    hints = args if fixed_length else [args[0] if args else Any] * len(value)
    elements = [
        read(x, h, rule, (*path, i), report) for i, (x, h) in enumerate(zip(value, hints, strict=True))
    ]
    return INVALID if any(element is INVALID for element in elements) else tuple(elements)


def _mapping(value: Raw, hint: Hint, rule: Rule, path: Path, report: Report) -> Any:
    if value is None:
        value = {}
    if not isinstance(value, dict):
        report(path, f"{dotted(path)} must be a mapping, got {echo(value)}")
        return INVALID
    elements = {key: read(element, hint, rule, (*path, key), report) for key, element in value.items()}
    return INVALID if any(element is INVALID for element in elements.values()) else elements
