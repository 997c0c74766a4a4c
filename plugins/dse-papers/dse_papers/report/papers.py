"""The numbers that papers print, and the systems that they publish: `published.yaml`, read once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from typing import Any, Literal, TypeVar

from dse.base.registry import param
from dse.config.values import read_object
from dse.config.yaml_lines import Document, parse
from dse.show.report import System

_FILE = "published.yaml"
T = TypeVar("T")

Kind = Literal["result", "setup", "cited"]
Value = float | str | tuple[float, ...]
"""A number, a number with its uncertainty as text, or several: the ends of a range, the sides of a frame."""


@dataclass(frozen=True)
class Entry:
    """One quantity of a paper: a number, or numbers by conditions, a level of mappings per key of `by`."""

    quantity: str = param(doc="what it is, in words")
    where: str = param(doc="where it is printed first")
    value: Any = param(doc="a number, a range, or a mapping from a condition to these")  # noqa: RUF009
    unit: str = param("", doc="unit")
    also: str = param("", doc="where else it is printed, and what contradicts it")
    by: Mapping[str, str] = field(default_factory=dict)
    reads: str = param("", doc="the fact of a study that stands beside it")
    lacks: str = param("", doc="why no fact of a study stands beside it")
    scale: bool = param(False, doc="whether it says how large the study is")


@dataclass(frozen=True)
class Holds:
    """What a study must hold to stand beside a paper."""

    families: tuple[str, ...] = param(doc="kinds of models, any of them")
    tasks: Mapping[str, int | None] = param(doc="tasks, any of them, with their number of classes")
    events: bool | None = param(None, doc="whether recordings are events; null: either")


@dataclass(frozen=True)
class Number:
    """One printed number.

    kind: whether the paper measured it, set it, or quotes it. key: its entry. condition: name -> value.
    about: the condition in words.
    """

    kind: Kind
    key: str
    entry: Entry
    condition: Mapping[str, str]
    value: Value

    @property
    def about(self) -> str:
        """The condition in words."""
        return ", ".join(self.entry.by[name].format(value) for name, value in self.condition.items())


@dataclass(frozen=True)
class Redrawn:
    """A printed figure, and ours that shows the same."""

    where: str = param(doc="the printed figure")
    figure: str = param(doc="name of a figure of `dse figure`")
    keys: Mapping[str, Any] = field(default_factory=dict)
    condition: Mapping[str, str] = field(default_factory=dict)
    families: tuple[str, ...] = param((), doc="whose best design it shows; empty: that of all of the paper")
    cells: tuple[tuple[int, int], ...] = param((), doc="numbers of a texture and a motion of the scene each")


@dataclass(frozen=True)
class Publication:
    """A paper and every number that it prints.

    name: a readable key. source: the paper, as in REFERENCES.md. recordings: whether they are public, the end
    of a sentence.
    """

    name: str = param(doc="readable key")
    title: str = param(doc="what the paper is about")
    source: str = param(doc="the paper, as in REFERENCES.md")
    recordings: str = param(doc="whether its recordings are public")
    holds: Holds = param(doc="what a study must hold to stand beside it")  # noqa: RUF009
    results: Mapping[str, Entry] = field(default_factory=dict)
    setup: Mapping[str, Entry] = field(default_factory=dict)
    cited: Mapping[str, Entry] = field(default_factory=dict)
    figures: tuple[Redrawn, ...] = param((), doc="printed figures that ours redraw")

    def numbers(self) -> Iterator[Number]:
        """Yield every printed number: results, then the set-up, then what the paper quotes."""
        sections: dict[Kind, Mapping[str, Entry]]
        sections = {"result": self.results, "setup": self.setup, "cited": self.cited}
        for kind, entries in sections.items():
            for key, entry in entries.items():
                for condition, value in _flat(entry.value, tuple(entry.by), {}):
                    yield Number(kind, key, entry, condition, value)

    def table(self, key: str, *conditions: str) -> dict[str, float]:
        """Return the numbers of an entry under some conditions, by the values of the next one."""
        value = {**self.cited, **self.setup, **self.results}[key].value
        for condition in conditions:
            value = value[condition]
        return dict(value)

    def number(self, key: str, *conditions: str) -> float:
        """Return one number of a result, of the set-up, or that the paper quotes."""
        *above, last = key, *conditions
        if above:
            return float(self.table(*above)[last])
        return float({**self.cited, **self.setup, **self.results}[key].value)


@dataclass(frozen=True)
class _System:
    """A published system. paper: its publication. families: ours that stand beside it."""

    title: str = param(doc="what the system is")
    paper: str = param(doc="the publication")
    families: tuple[str, ...] = param(doc="model families that stand beside it")


@cache
def _systems() -> dict[str, _System]:
    return {letter: _read(_System, ("systems", letter)) for letter in _document().data["systems"]}  # type: ignore[index]


@cache
def systems() -> dict[str, System]:
    """Return every published system by its letter."""
    return {
        letter: System(one.title, publication(one.paper).source, one.families)
        for letter, one in _systems().items()
    }


def publication_of(letter: str) -> Publication:
    """Return the paper of a system."""
    return publication(_systems()[letter].paper)


@cache
def publications() -> dict[str, Publication]:
    """Return every paper by its number, such as '002'."""
    written: Any = _document().data
    return {key: publication(key) for key in written if key != "systems"}


def key_of(name: str) -> str | None:
    """Return the number of a paper from it, its readable name or its source; None: there is no such paper."""
    papers = publications().items()
    return next((key for key, paper in papers if name in (key, paper.name, paper.source)), None)


@cache
def publication(key: str) -> Publication:
    """Return a paper by its number.

    Raises:
        ConfigError: a key is missing or unknown.
    """
    return _read(Publication, (key,))


def _flat(
    value: Any, names: tuple[str, ...], above: Mapping[str, str]
) -> Iterator[tuple[dict[str, str], Value]]:
    """Yield the conditions and the value of every number of an entry."""
    if not names:
        yield dict(above), value
        return
    for name, inner in value.items():
        yield from _flat(inner, names[1:], {**above, names[0]: name})


@cache
def _document() -> Document:
    text = (resources.files("dse_papers.report") / _FILE).read_text(encoding="utf-8")
    return parse(text, _FILE)


def _read(cls: type[T], path: tuple[str, ...]) -> T:
    document = _document()
    written: Any = document.data
    for key in path:
        written = written[key]
    record = read_object(cls, written, path, document.report)
    document.check()
    assert record is not None  # else there were faults
    return record
