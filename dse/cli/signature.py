"""The arguments of a command: the signature of its function says what they are, its docstring what they mean.

A parameter before `*` is an argument without a name, one after it an option; a default makes it optional, a
tuple may be given repeatedly. Types are those of the reader of YAML, bounds are in `Annotated`,
and a line of section `Args` is `name: meaning.`, or `name (METAVAR): meaning.` where help calls the value so.
A parameter that is a frozen dataclass stands for its fields, which `param` declares, `Without` some of them;
`**name: Annotated[str | None, known]` for the options that `known()` names with their meaning.
What several commands have is described once, in `_SHARED`.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import inspect
import re
import typing
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin

from dse.base.registry import Rule
from dse.cli.answer import add_format
from dse.config import ConfigError, Fault
from dse.config.values import Key, is_list, keys_of, number_type, read
from dse.config.yaml_lines import scalar

_LINE = re.compile(r"^( *)(\w+)(?: \(([^)]*)\))?: (.*(?:\n\1 +\S.*)*)", re.MULTILINE)

Count = Annotated[int | None, Rule(low=1)]
"""A number of things, from 1."""
Amount = Annotated[float | None, Rule(low=0)]
Texts = tuple[str, ...]

_SHARED = """
    bundle: folder written by `dse pick --export`.
    data (RECORDINGS): recordings in the format of the training data.
    hardware (NAME): compute costs on this hardware profile (name or YAML file); nothing is retrained;
        repeatable.
    objectives (LIST): e.g. accuracy:max,energy_uj:min (default: those of the study).
    repair: repair damaged event files or leave them out, with a warning for each, instead of stopping.
    results: folder of a study.
    set (KEY=VALUE): replace the value of a key, e.g. data.file=touch.npz or
        'model.hidden={choice: [50, 100]}'; repeatable.
    space: a YAML file, or the name of a shipped search space.
    target (NAME): target to write (`dse describe targets`); repeatable.
    verify (RECORDINGS): run each target on these recordings, in the format of the training data, and compare
        all decisions and spikes; a target that shows less than its verdict of before gives exit code 4.
    where (EXPR): keep the points that meet this condition, e.g. "n_weights <= 100000 and phi > 2";
        repeatable: all must be met.
"""
"""What several commands have; a command's own docstring comes first."""


class Without(tuple[str, ...]):
    """Fields of a dataclass that are no arguments: `Annotated[Question, Without(["by"])]`."""


class Argument(typing.NamedTuple):
    """An argument of a command; is_named: an option; metavar: what help calls its value, '': by its type."""

    key: Key
    is_named: bool
    metavar: str
    doc: str


def summary(function: Callable[..., Any]) -> str:
    """Return the first sentence of a command's docstring, as `dse --help` prints it."""
    text = " ".join((inspect.getdoc(function) or "").partition("\n\n")[0].split()).removesuffix(".")
    return text[:1].lower() + text[1:]


def arguments_of(function: Callable[..., Any]) -> dict[str, Argument]:
    """Return the arguments of a command by name, in the order of its signature."""
    found: dict[str, Argument] = {}
    docs = _docs(_SHARED) | _docs(function.__doc__)
    for name, hint, extra, parameter in _parameters(function):
        if name == "format":
            continue
        if dataclasses.is_dataclass(hint):
            for own, key in _fields(hint, extra).items():
                metavar, doc = docs.get(own, ("", key.rule.doc))
                found[own] = Argument(key, True, metavar, doc)
            continue
        if parameter.kind is parameter.VAR_KEYWORD:
            of_each: dict[str, str] = extra[0]()
            found |= {
                own: Argument(Key(hint, Rule(), lambda: None), True, "", doc) for own, doc in of_each.items()
            }
            continue
        [rule] = [x for x in extra if isinstance(x, Rule)] or [Rule()]
        is_required = parameter.default is parameter.empty
        key = Key(hint, rule, None if is_required else functools.partial(getattr, parameter, "default"))
        found[name] = Argument(key, parameter.kind is parameter.KEYWORD_ONLY, *docs[name])
    return found


def _parameters(function: Callable[..., Any]) -> Iterator[tuple[str, Any, list[Any], inspect.Parameter]]:
    """Yield name, type, what the annotation adds to it, and the rest, of each parameter."""
    hints = typing.get_type_hints(function, include_extras=True)
    for name, parameter in inspect.signature(function).parameters.items():
        is_annotated = get_origin(hints[name]) is Annotated
        hint, *extra = get_args(hints[name]) if is_annotated else (hints[name],)
        yield name, hint, extra, parameter


def _fields(cls: Any, extra: list[Any]) -> dict[str, Key]:
    """Return the fields of a dataclass that are arguments."""
    left_out = {name for x in extra if isinstance(x, Without) for name in x}
    return {name: key for name, key in keys_of(cls).items() if name not in left_out}


def _docs(text: str | None) -> dict[str, tuple[str, str]]:
    """Return name -> metavar and meaning of what a docstring describes."""
    lines = _LINE.finditer(inspect.cleandoc(text or ""))
    return {x[2]: (x[3] or "", " ".join(x[4].split()).removesuffix(".")) for x in lines}


def declare(parser: argparse.ArgumentParser, function: Callable[..., Any]) -> None:
    """Declare the arguments of a command, and `--format` unless it prints a form of its own."""
    found = arguments_of(function)
    for name, (key, is_named, metavar, doc) in found.items():
        keywords: dict[str, Any] = {"help": doc.replace("%", "%%")}
        if key.default is not None:
            default = key.default()
            keywords["default"] = list(default) if isinstance(default, tuple) else default
        elif is_named:
            keywords["required"] = True
        if bool in (key.hint, *get_args(key.hint)):
            optional = argparse.BooleanOptionalAction
            keywords["action"] = "store_true" if key.default and key.default() is False else optional
        else:
            choices = key.rule.choices or _literals(key.hint)
            usual = "N" if number_type(key.hint) else name.upper()
            keywords |= {"choices": choices} if choices else {"metavar": metavar or usual}
            keywords |= {"type": _reader(key), **_how_many(key, is_named)}
        parser.add_argument(f"--{name.replace('_', '-')}" if is_named else name, **keywords)
    if "json" not in found:
        add_format(parser)


def call(function: Callable[..., Any], parsed: argparse.Namespace) -> Any:
    """Return what a command answers to what was parsed."""
    given = {name: tuple(x) if isinstance(x, list) else x for name, x in vars(parsed).items()}
    arguments: dict[str, Any] = {}
    for name, hint, extra, parameter in _parameters(function):
        if dataclasses.is_dataclass(hint):
            arguments[name] = typing.cast(type, hint)(**{own: given[own] for own in _fields(hint, extra)})
        elif parameter.kind is parameter.VAR_KEYWORD:
            arguments |= {own: given[own] for own in extra[0]()}
        else:
            arguments[name] = given[name]
    return function(**arguments)


def number(text: str, **rule: Any) -> float:
    """Return the number that somebody has typed; keywords are those of `registry.Rule`."""
    try:
        return float(_reader(Key(float, Rule(**rule), None))(text))
    except argparse.ArgumentTypeError as error:
        raise ConfigError([Fault("dse", 0, f"a number {error}")]) from None


def _literals(hint: Any) -> tuple[Any, ...]:
    """Return the texts that a type lists; () if it lists none."""
    if get_origin(hint) is Literal:
        return get_args(hint)
    return next((found for one in get_args(hint) if (found := _literals(one))), ())


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
    kind = str if _literals(key.hint) else kinds[0]
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
