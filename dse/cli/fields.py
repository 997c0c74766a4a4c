"""Arguments of a command as fields of a frozen dataclass, checked by the rules of the reader of YAML."""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar, get_args

from dse.cli.answer import add_format
from dse.config import ConfigError, Fault
from dse.config.values import Key, is_list, keys_of, number_type, read
from dse.config.yaml_lines import scalar
from dse.registry import Rule

T = TypeVar("T")


def argument(metavar: str, doc: str, default: Any = dataclasses.MISSING, **rule: Any) -> Any:
    """Declare an argument that stands without a name; keywords are those of `registry.Rule`."""
    return _field(default, Rule(doc=doc, **rule), metavar=metavar, is_named=False)


def option(metavar: str, doc: str, default: Any = None, **rule: Any) -> Any:
    """Declare `--name METAVAR`; a tuple may be given repeatedly, MISSING as the default requires it."""
    return _field(default, Rule(doc=doc, **rule), metavar=metavar)


def flag(doc: str, default: bool | None = False) -> Any:
    """Declare `--name`, which sets the field; where it is None by default, `--no-name` unsets it."""
    return _field(default, Rule(doc=doc))


def formats(names: Sequence[str] = ("table", "json")) -> Any:
    """Declare `--format` and its short form `--json`."""
    return _field(None, Rule(doc="", choices=tuple(names)))


def like(cls: type, name: str) -> Any:
    """Declare a field as another dataclass does."""
    (one,) = (field for field in dataclasses.fields(cls) if field.name == name)
    return dataclasses.field(default=one.default, metadata=one.metadata)


def hidden(value: Any) -> Any:
    """Declare that a field of a class above is no argument, and which value it has."""
    return dataclasses.field(default=value, init=False)


def _field(default: Any, rule: Rule, **written: Any) -> Any:
    return dataclasses.field(default=default, metadata={"rule": rule, **written})


def declare(parser: argparse.ArgumentParser, cls: type) -> None:
    """Declare an argument for each field of a dataclass."""
    metadata = {field.name: field.metadata for field in dataclasses.fields(cls)}
    for name, key in keys_of(cls).items():
        if name == "format":
            add_format(parser, key.rule.choices)
            continue
        is_named = metadata[name].get("is_named", True)
        names = [f"--{name.replace('_', '-')}"] if is_named else [name]
        keywords: dict[str, Any] = {"help": key.rule.doc.replace("%", "%%")}
        if key.default is not None:
            default = key.default()
            keywords["default"] = list(default) if isinstance(default, tuple) else default
        elif is_named:
            keywords["required"] = True
        if bool in (key.hint, *get_args(key.hint)):
            optional = argparse.BooleanOptionalAction
            keywords["action"] = "store_true" if key.default and key.default() is False else optional
        else:
            usual = "N" if number_type(key.hint) else "NAME"
            keywords |= {"type": _reader(key), "metavar": metadata[name].get("metavar", usual)}
            keywords |= _how_many(key, is_named)
        if key.rule.choices:
            keywords["choices"] = key.rule.choices
            del keywords["metavar"]
        parser.add_argument(*names, **keywords)


def made(cls: type[T], parsed: argparse.Namespace) -> T:
    """Return the dataclass of what was parsed."""
    values = {name: getattr(parsed, name) for name in keys_of(cls)}
    return cls(**{name: tuple(x) if isinstance(x, list) else x for name, x in values.items()})


def number(text: str, **rule: Any) -> float:
    """Return the number that somebody has typed; keywords are those of `registry.Rule`.

    Raises:
        ConfigError: it is none, or outside its bounds.
    """
    try:
        return float(_reader(Key(float, Rule(doc="", **rule), None))(text))
    except argparse.ArgumentTypeError as error:
        raise ConfigError([Fault("dse", 0, f"a number {error}")]) from None


def _how_many(key: Key, is_named: bool) -> dict[str, Any]:
    """Return how often an argument may stand: texts are repeated with their name, numbers follow it."""
    if not is_list(key.hint):
        return {} if is_named or key.default is None else {"nargs": "?"}
    if is_named and not number_type(key.hint):
        return {"action": "append"}
    return {"nargs": "+" if is_named or key.default is None else "*"}


def _reader(key: Key) -> Callable[[str], Any]:
    """Return the function that reads one value from its text."""
    kinds = [kind for kind in get_args(key.hint) or (key.hint,) if kind not in (type(None), Ellipsis)]
    (kind,) = kinds
    if kind is Path:
        return Path

    def value(text: str) -> Any:
        faults: list[str] = []
        written = text if kind is str else scalar(text)
        found = read(written, kind, key.rule, (), lambda _, fault: faults.append(fault.strip()))
        if faults:
            raise argparse.ArgumentTypeError(faults[0])
        return found

    return value
