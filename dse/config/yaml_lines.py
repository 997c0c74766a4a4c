"""YAML text -> plain data that remembers on which line every value stands.

Scalars follow the core schema of YAML 1.2, not 1.1: `no` and `on` are text, `1e-3` is a number.
Keys are always text. Source: yaml.org/spec/1.2.2, section 10.3.2.
"""

from __future__ import annotations

import pathlib
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import yaml

from dse.config.bounds import MOST_YAML_BYTES, MOST_YAML_VALUES
from dse.config.faults import ConfigError, Fault

Path = tuple[str | int, ...]

Raw = object
"""A value as YAML or JSON holds it; a reader checks its type before it uses the value."""

_CONSTANTS: dict[str, Raw] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}
_INTEGER = re.compile(r"[-+]?[0-9]+")
_BASE = re.compile(r"0o[0-7]+|0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_SPECIAL = re.compile(r"([-+]?)\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
_PLAIN_TAGS = {f"tag:yaml.org,2002:{name}" for name in ("str", "seq", "map")}
_DEEPEST = 50
_LONGEST_NUMBER = 250  # digits: every integer is less than the largest float


@dataclass(frozen=True)
class Document:
    """Plain data and the place of every path in it.

    places: path -> (file or `--set key`, line).
    """

    data: Raw
    places: dict[Path, tuple[str, int]]
    faults: list[Fault] = field(default_factory=list)

    def report(self, path: Path, message: str) -> None:
        """Add a fault at a path."""
        self.faults.append(self.fault(path, message))

    def check(self) -> None:
        """Raise what was reported.

        Raises:
            ConfigError: there are faults.
        """
        if self.faults:
            raise in_file_order(self.faults)

    def fault(self, path: Path, message: str) -> Fault:
        """Return a fault at a path, or at the nearest enclosing path that stands in the text."""
        path = located(self.data, path)
        while path not in self.places:
            path = path[:-1]
        return Fault(*self.places[path], message)


def located(data: Raw, path: Path) -> Path:
    """Return where a key stands: `model.elm.hidden` in the entry of kind elm where `model` is a choice."""
    section = data.get(path[0]) if path and isinstance(data, dict) else None
    entries = section.get("choice") if isinstance(section, dict) else None
    for index, entry in enumerate(entries if isinstance(entries, list) and len(path) > 1 else ()):
        kind = entry.get("kind") if isinstance(entry, dict) else entry
        if isinstance(kind, str) and kind == path[1]:
            return (path[0], "choice", index, *path[2:])
    return path


def scalar(text: str) -> Any:
    """Return the value of a plain (unquoted) scalar."""
    if text in _CONSTANTS:
        return _CONSTANTS[text]
    if len(text) > _LONGEST_NUMBER:
        return text
    if _INTEGER.fullmatch(text):
        return int(text)
    if _BASE.fullmatch(text):
        return int(text, 0)
    if _FLOAT.fullmatch(text):
        return float(text)
    if special := _SPECIAL.fullmatch(text):
        return float(f"{special[1] or ''}inf" if special[2] else "nan")
    return text


def read_document(source: pathlib.Path, values: Mapping[str, str]) -> Document:
    """Read a YAML file with values replaced on the command line.

    Raises:
        ConfigError: the file cannot be read, or is no UTF-8 text.
    """
    try:
        if (n_bytes := source.stat().st_size) > MOST_YAML_BYTES:
            text = f"must have at most {MOST_YAML_BYTES} bytes, got {n_bytes}"
            raise ConfigError([Fault(str(source), 1, text)])
        text = source.read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigError([Fault(str(source), 0, f"cannot be read: {error.strerror}")]) from None
    except UnicodeDecodeError:
        raise ConfigError([Fault(str(source), 0, "cannot be read: not UTF-8 text")]) from None
    return override(parse(text, str(source)), values)


def plain_document(data: Mapping[str, object], name: str) -> Document:
    """Return a mapping of Python as a document without lines, with the values that YAML has."""
    return Document(_as_yaml(data), {(): (name, 0)})


def _as_yaml(value: Any) -> Any:
    """Return mappings, lists and numbers of Python and numpy as those of YAML, everything else as it is."""
    if isinstance(value, Mapping):
        return {str(key): _as_yaml(inner) for key, inner in value.items()}
    if hasattr(value, "tolist"):  # arrays and numbers of numpy
        return _as_yaml(value.tolist())
    if isinstance(value, list | tuple | range | set | frozenset):
        return [_as_yaml(inner) for inner in value]
    return str(value) if isinstance(value, pathlib.Path) else value


def in_file_order(faults: Iterable[Fault]) -> ConfigError:
    """Return the error of all faults: those of the file by line, then those of the command line."""
    return ConfigError(sorted(dict.fromkeys(faults), key=lambda fault: (fault.line == 0, fault.line)))


def error_of(source: pathlib.Path, faults: Iterable[str]) -> ConfigError:
    """Return sentences about a file as faults, each on the line of the key that it begins with."""
    document = read_document(source, {})
    keys = ((tuple(re.split("[ :]", text, maxsplit=1)[0].split(".")), text) for text in faults)
    return in_file_order(document.fault(key, text) for key, text in keys)


def parse(text: str, name: str) -> Document:
    """Read one YAML document; syntax errors and duplicate keys become faults of `name`."""
    document = Document({}, {(): (name, 1)})
    if len(text) > MOST_YAML_BYTES:
        document.faults.append(Fault(name, 1, f"must have at most {MOST_YAML_BYTES} bytes, got {len(text)}"))
        return document
    line = 1
    try:
        node = _compose(text)
        data = {} if node is None else _value(node, (), document, name)
        return Document(data, document.places, document.faults)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else 1
        problem = " ".join(filter(None, ("not valid YAML:", error.context, error.problem)))
    except yaml.reader.ReaderError as error:
        line, problem = text.count("\n", 0, error.position) + 1, f"not valid YAML: {error.reason}"
    except RecursionError:
        problem = f"not valid YAML: nested more than {_DEEPEST} levels deep"
    except _TooManyError as error:
        line = int(str(error))
        problem = f"has more than {MOST_YAML_VALUES} values here; an alias counts with all that it names"
    return Document({}, {(): (name, 1)}, [Fault(name, line, problem)])


# Base loaders resolve nothing, so quoted and plain scalars can be told apart below.
if yaml.__with_libyaml__:

    class _Loader(yaml.composer.Composer, yaml.CBaseLoader):
        """Reads by libyaml, ten times as fast; makes nodes in Python, where deep nesting ends in an error."""

        def __init__(self, text: str) -> None:
            yaml.CBaseLoader.__init__(self, text)
            yaml.composer.Composer.__init__(self)


def _compose(text: str) -> yaml.Node | None:
    """Return the nodes of a text; what libyaml does not read gets the verdict of PyYAML's own parser."""
    if yaml.__with_libyaml__:
        try:
            return yaml.compose(text, Loader=_Loader)
        except (yaml.YAMLError, UnicodeEncodeError):
            pass
    return yaml.compose(text, Loader=yaml.BaseLoader)


def override(document: Document, values: Mapping[str, str]) -> Document:
    """Replace dotted keys by values written as YAML (`model.hidden={choice: [50, 100]}`).

    A section that is a name alone is a mapping of that kind, so that keys can be added to it; where it is a
    choice, `model.elm.hidden` is a key of the entry of kind elm.
    """
    data, places, faults = document.data, dict(document.places), list(document.faults)
    if values and not isinstance(data, dict):
        data = {}
    for key, text in values.items():
        path: Path = tuple(key.split("."))
        source = f"--set {key}"
        if not all(path):
            faults.append(Fault(source, 0, f"must be a dotted key such as data.file, got '{key}'"))
            continue
        setting = parse(text, source)
        if setting.faults:
            faults += [Fault(source, 0, fault.message) for fault in setting.faults]
            continue
        path = located(data, path)
        places = {known: place for known, place in places.items() if known[: len(path)] != path}
        places |= {path + sub: (source, 0) for sub in setting.places}
        for length in range(1, len(path)):  # a section that only the command line names
            places.setdefault(path[:length], (source, 0))
        data = _replaced(data, path, setting.data if text.strip() else None)
    return Document(data, places, faults)


def _replaced(data: Raw, path: Path, value: Raw, depth: int = 0) -> Any:
    if not path:
        return value
    key, rest = path[0], path[1:]
    if isinstance(key, int):  # an entry of the choice of a section
        assert isinstance(data, list)  # so `located` has found
        return [*data[:key], _replaced(data[key], rest, value, 1), *data[key + 1 :]]
    inner = data if isinstance(data, dict) else {"kind": data} if depth == 1 and isinstance(data, str) else {}
    return {**inner, key: _replaced(inner.get(key), rest, value, depth + 1)}


class _TooManyError(Exception):
    """A document without end; its text is the line."""


def _value(node: yaml.Node, path: Path, document: Document, name: str) -> Any:
    line = node.start_mark.line + 1
    if len(document.places) > MOST_YAML_VALUES:
        raise _TooManyError(line)
    if len(path) > _DEEPEST:  # an alias inside its own anchor never ends
        document.faults.append(Fault(name, line, f"nested more than {_DEEPEST} levels deep"))
        return None
    if node.tag not in _PLAIN_TAGS:
        document.faults.append(Fault(name, line, f"YAML tags are not supported, got '{node.tag}'"))
    if isinstance(node, yaml.ScalarNode):
        return node.value if node.style else scalar(node.value)
    if isinstance(node, yaml.SequenceNode):
        for index, child in enumerate(node.value):
            document.places[(*path, index)] = (name, child.start_mark.line + 1)
        return [_value(child, (*path, index), document, name) for index, child in enumerate(node.value)]
    data: dict[str, Raw] = {}
    for key_node, child in node.value:
        key_line = key_node.start_mark.line + 1
        if not isinstance(key_node, yaml.ScalarNode):
            document.faults.append(Fault(name, key_line, "a key must be a scalar, got a list or a mapping"))
            continue
        key = str(key_node.value)
        if key in data:
            first = document.places[(*path, key)][1]
            where = ".".join(map(str, (*path, key)))
            document.faults.append(Fault(name, key_line, f"duplicate key '{where}', first on line {first}"))
            continue
        document.places[(*path, key)] = (name, key_line)
        data[key] = _value(child, (*path, key), document, name)
    return data


class _Dumper(yaml.SafeDumper):
    """Writes text so that `scalar` reads it back as text, and never writes aliases."""

    def ignore_aliases(self, data: Raw) -> bool:
        return True


def _represent_text(dumper: yaml.SafeDumper, text: str) -> yaml.Node:
    style = None if isinstance(scalar(text), str) else "'"
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


_Dumper.add_representer(str, _represent_text)
_Dumper.add_representer(tuple, lambda dumper, value: dumper.represent_list(list(value)))


def dump(data: Mapping[str, Raw]) -> str:
    """Write plain data as YAML that `parse` reads back to the same data (tuples become lists)."""
    return yaml.dump(
        dict(data), Dumper=_Dumper, sort_keys=False, default_flow_style=None, width=100, allow_unicode=True
    )
