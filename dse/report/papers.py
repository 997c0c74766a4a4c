"""The figures that papers print: `published.yaml`, one record per system."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import TypeVar, cast

from dse.config.faults import ConfigError, Fault
from dse.config.values import read_object
from dse.config.yaml_lines import Document, Path, Raw, parse
from dse.registry import param

_FILE = "published.yaml"


@dataclass(frozen=True)
class Paper:
    """A published system. A system's own record has its figures as further fields.

    title: what it is.
    source: the paper, as in REFERENCES.md.
    families: ours that stand beside it.
    """

    title: str = param(doc="what the system is")
    source: str = param(doc="the paper, as in REFERENCES.md")
    families: tuple[str, ...] = param(doc="model families that stand beside it")


P = TypeVar("P", bound=Paper)


@cache
def papers() -> dict[str, Paper]:
    """Return every published system by its letter, without its figures."""
    return {system: _read(Paper, system, tuple(keys)) for system, keys in _systems(_document()).items()}


def paper(system: str, cls: type[P]) -> P:
    """Return a published system with its figures.

    Args:
        system: its letter.
        cls: record of its figures.

    Raises:
        ConfigError: a figure is missing or is none of the record.
    """
    return _read(cls, system, ())


@cache
def _document() -> Document:
    text = (resources.files("dse.report") / _FILE).read_text(encoding="utf-8")
    return parse(text, _FILE)


def _systems(document: Document) -> Mapping[str, Mapping[str, Raw]]:
    """Return the keys of each system, as written."""
    return cast(Mapping[str, Mapping[str, Raw]], document.data)


def _read(cls: type[P], system: str, also: tuple[str, ...]) -> P:
    document = _document()
    faults: list[Fault] = list(document.faults)

    def report(path: Path, message: str) -> None:
        faults.append(document.fault(path, message))

    record = read_object(cls, _systems(document)[system], (system,), report, also=also)
    if faults or record is None:
        raise ConfigError(faults)
    return record
