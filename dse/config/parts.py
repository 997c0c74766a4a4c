"""One section of the file -> its values, with its axes apart; all rules of its class checked.

A rule between sections belongs to the component that needs it: a class may have a class method
`faults(part, space)`, which yields what other sections of a search space (`Written`) lack for its own.
"""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path as Folder
from typing import Any, NamedTuple

from dse.base import registry
from dse.base.registry import Rule, elsewhere, rule_of
from dse.config.axes import Axis, is_axis, parse_axis
from dse.config.faults import known_names
from dse.config.locate import is_hardware_file, shipped_profiles
from dse.config.values import (
    INVALID,
    Hint,
    Report,
    Values,
    blamed,
    components_named,
    construct,
    dotted,
    echo,
    expected,
    keys_of,
    plain,
    read,
    read_fields,
    read_object,
)
from dse.config.yaml_lines import Path, Raw, parse

COMPONENTS = {"data": "recordings", "encoder": "encoders", "model": "models"}
"""Section of a search space -> section of the registry whose components its `kind` names."""
FAMILIES = ("encoder", "model")
"""Sections whose component may be an axis."""
WITH_AXES = ("window", "preprocessing", "encoder", "model", "training", "task")

KeyFault = tuple[Path, str]
"""Where a key is that has a fault, and the sentence about it."""

# Cross-field rules are tried on at most this many combinations of a section's own axes.
_MOST_COMBINATIONS = 1000


@dataclass(frozen=True)
class Part:
    """A section as it is written: its class, key -> value, and dotted name -> axis for the keys that vary.

    kind: name of the component; '' where the section is one dataclass.
    good: nothing in it was at fault; otherwise the keys at fault are missing.
    entries: kind -> its part where the section is a choice of several components; `values` is empty then.
    path: of the section, with the kind where it is one of a choice.
    """

    cls: type
    kind: str
    values: Values
    axes: dict[str, Axis]
    good: bool
    entries: dict[str, Part] = field(default_factory=dict)
    path: Path = ()

    @property
    def each(self) -> tuple[Part, ...]:
        """The components of the section: itself, or those that it is a choice of."""
        return tuple(self.entries.values()) or (self,)

    def range(self, key: str) -> tuple[Any, ...]:
        """Return the values that a key has in some design, of a range its ends; empty: none is right."""
        axis = next((axis for axis in self.axes.values() if axis.place[1] == key), None)
        if axis is not None:
            return axis.extremes()
        return (self.values[key],) if key in self.values else ()

    def fault(self, key: str, text: str) -> KeyFault:
        """Return what is wrong with a key, given the sentence after its name."""
        path = (*self.path, key)
        return path, f"{dotted(path)} {text}"

    def blamed(self, message: str) -> KeyFault:
        """Return what an error of the section's class is about: the key that its sentence begins with."""
        return blamed(message, {*self.values, *(axis.place[1] for axis in self.axes.values())}, self.path)

    def built(self, varied: Values) -> Any:
        """Return the object of the section, given the values of the keys that vary.

        Raises:
            ValueError: its class refuses the values together.
        """
        return construct(self.cls, {**self.values, **varied}) if varied else self.fixed

    @cached_property
    def fixed(self) -> Any:
        """The object of a section in which no key varies."""
        return construct(self.cls, self.values)

    def components(self, section: str) -> list[str]:
        """Return the names of the components of a section that its keys name, in any design."""
        return [name for rule, names in self._named() if rule.component == section for name in names]

    def classes(self) -> list[type]:
        """Return the class of the section and those of the components that its keys name, in any design."""
        return [self.cls, *(cls for _, named in self._named() for cls in named.values())]

    def _named(self) -> Iterator[tuple[Rule, dict[str, type]]]:
        values = self.values | {axis.place[1]: axis for axis in self.axes.values()}
        for one in dataclasses.fields(self.cls):
            if (rule := rule_of(one)).component and one.name in values:
                yield rule, components_named(values[one.name], rule)

    def corners(self) -> Iterator[Values]:
        """Yield the values at every corner of the section's axes; of very many axes not all."""
        keys = [axis.place[1] for axis in self.axes.values()]
        ends = [[axis.wrapped(value) for value in axis.extremes()] for axis in self.axes.values()]
        for combination in itertools.islice(itertools.product(*ends), _MOST_COMBINATIONS):
            yield dict(zip(keys, combination, strict=True))

    def at_ends(self) -> Iterator[Any]:
        """Yield the objects of the section at every corner of its axes, where its class takes the values."""
        for varied in self.corners():
            with contextlib.suppress(ValueError):
                yield self.built(varied)

    def refusals(self) -> list[str]:
        """Return what its class refuses, a sentence each, at every corner of its axes."""
        messages: dict[str, None] = {}
        for varied in self.corners() if any(hasattr(x, "__post_init__") for x in self.classes()) else ():
            try:
                self.built(varied)
            except ValueError as error:
                messages.setdefault(str(error))
        return list(messages)

    def to_plain(self) -> dict[str, Raw]:
        """Return the section as it is written in YAML, with every default."""
        kind = {"kind": self.kind} if self.kind else {}
        axes = {axis.place[1]: axis.to_plain() for axis in self.axes.values()}
        return kind | {key: plain(value) for key, value in self.values.items()} | axes


class Chip(NamedTuple):
    """A profile of section `hardware`: its place there, its name, what its file holds, its kind."""

    place: int
    name: str
    profile: Mapping[str, Raw]
    kind: Any

    @property
    def is_fixed(self) -> bool:
        """Whether its neurons cannot be programmed."""
        return self.profile.get("programmable") is not True and not self.kind.any_neuron


def whole_profile(data: Mapping[str, Raw]) -> dict[str, Raw]:
    """Return what a profile holds, with all that it takes over from the shipped one that it is `like`."""
    like = shipped_profiles().get(str(data.get("like")))
    base = {} if like is None else parse(like.read_text(encoding="utf-8"), like.name).data
    assert isinstance(base, dict)
    taken = {key: value for key, value in base.items() if key not in ("name", "doc", "label")}
    return {**(whole_profile(taken) if "like" in taken else taken), **data}


def chips(names: Sequence[str], base: Folder) -> Iterator[Chip]:
    """Yield the chips whose profile is found and whose kind is known.

    Args:
        names: hardware profiles, or their files.
        base: folder of the search space, which files are relative to.
    """
    kinds = registry.known("hardware.kinds")
    for index, name in enumerate(names):
        path = base / name if is_hardware_file(name) else shipped_profiles().get(name)
        if path is None or not path.is_file():
            continue
        data = parse(path.read_text(encoding="utf-8"), name).data
        profile = whole_profile(data) if isinstance(data, dict) else {}
        if (kind := kinds.get(str(profile.get("kind")))) is not None:
            yield Chip(index, name, profile, kind)


@dataclass(frozen=True)
class Written:
    """A search space as it is written, which the rules between its sections look at.

    parts: section -> what is written there.
    hardware: profiles, or their files.
    base: folder of the search space, which files are relative to.
    is_run: whether what a run needs must be there: packages, a device, folders.
    """

    parts: Mapping[str, Part]
    hardware: tuple[str, ...]
    base: Folder
    is_run: bool

    @cached_property
    def axes(self) -> dict[str, Axis]:
        """The axes of the designs, by dotted name, in the order of the sections."""
        varied = [part.axes for name, part in self.parts.items() if name in WITH_AXES]
        return {name: axis for axes in varied for name, axis in axes.items()}

    def each(self, section: str) -> tuple[Part, ...]:
        """Return the components that a section may be; empty without the section."""
        return self.parts[section].each if section in self.parts else ()

    def range(self, section: str, key: str) -> tuple[Any, ...]:
        """Return the values that a key of a section has in some design, of a range its ends."""
        return tuple(value for part in self.each(section) for value in part.range(key))

    @cached_property
    def chips(self) -> list[Chip]:
        """The hardware whose profile is found and whose kind is known."""
        return list(chips(self.hardware, self.base))

    def faults(self) -> Iterator[KeyFault]:
        """Yield what the rules of all components say about other sections."""
        for part in (one for name in self.parts for one in self.each(name)):
            for cls in part.classes():
                if rules := getattr(cls, "faults", None):
                    yield from rules(part, self)
        for chip in self.chips:
            yield from chip.kind.faults(chip, self)


def settings(section: str, cls: type, raw: Raw, report: Report) -> Part:
    """Read a section that is one dataclass."""
    one = read_or_axis if section in (*WITH_AXES, "decision") else read_fixed
    part = _apart((section,), cls, "", *read_fields(cls, raw, (section,), report, one), report)
    return _with_name(part) if section == "task" else part


def component(path: Path, raw: Raw, report: Report) -> Part | None:
    """Read a component, of an encoder or a model also by its name alone; None where no kind is known.

    path: its section, and its kind where the section is a choice of several.
    """
    section = str(path[0])
    known, by_name = registry.known(COMPONENTS[section]), section in FAMILIES
    named = _class_and_keys(path, section, raw, known, report, by_name=by_name)
    if named is None:
        return None
    kind, keys = named
    one = read_or_axis if section in WITH_AXES else read_fixed
    return _apart(path, known[kind], kind, *read_fields(known[kind], keys, path, report, one), report)


def named(path: Path, raw: Raw, known: Mapping[str, type], report: Report) -> Any:
    """Return the component that a key holds, given its name or a mapping with a kind; None after a fault."""
    found = _class_and_keys(path, dotted(path), raw, known, report, by_name=True)
    return None if found is None else read_object(known[found[0]], found[1], path, report, read_fixed)


def _class_and_keys(
    path: Path, name: str, raw: Raw, known: Mapping[str, type], report: Report, *, by_name: bool
) -> tuple[str, dict[str, Raw]] | None:
    """Return the kind that a mapping names and its other keys; None after a fault."""
    raw = {"kind": raw} if by_name and isinstance(raw, str) else raw
    if not isinstance(raw, dict):
        report(path, f"{name} must be a mapping with a kind, got {echo(raw)}")
    elif "kind" not in raw:
        report(path, f"{name}.kind is required; {known_names('', known)}")
    elif not isinstance(kind := raw["kind"], str) or kind not in known:
        where = elsewhere(COMPONENTS.get(name, ""), str(kind))
        text = f"unknown {name}.kind {echo(kind)}{where}; {known_names(str(kind), known)}"
        report((*path, "kind"), text)
    else:
        return kind, {key: value for key, value in raw.items() if key != "kind"}
    return None


def family(section: str, raw: Raw, report: Report) -> Part | None:
    """Read a section that holds one component or a choice of several; None where no kind is known.

    A name alone is the component with its defaults, and a choice of one is that one. The names of several are
    the axis `<section>.kind`; an axis of one of them is called `<section>.<kind>.<key>`.
    """
    if not (isinstance(raw, dict) and "choice" in raw):
        return component((section,), raw, report)
    where, entries = (section, "choice"), raw["choice"]
    if not isinstance(entries, list | tuple) or not entries:
        report(where, f"{section}.choice must be a list of one or more components, got {echo(entries)}")
        return None
    parts: dict[str, Part] = {}
    good = True
    for index, entry in enumerate(entries):
        part = _entry(section, entry, (*where, index), len(entries) > 1, report)
        good &= part is not None and part.good
        if part is not None and part.kind in parts:
            good = False
            report((*where, index), f"{section}.choice has '{part.kind}' twice")
        elif part is not None:
            parts[part.kind] = part
    for key in raw:
        if key != "choice":
            good = False
            report((section, key), f"unknown key '{section}.{key}'; {known_names(key, ['choice', *parts])}")
    if len(entries) == 1:
        return next(iter(parts.values()), None)
    kinds = Axis(f"{section}.kind", tuple(parts))
    for part in parts.values():
        for axis in part.axes.values():
            if axis.condition is not None:
                good = False
                of = f"only designs with {axis.condition[0]} {' or '.join(axis.condition[1:])} have it"
                report(where, f"{axis.name} cannot be an axis in a choice of components: {of}")
    axes = {
        name: dataclasses.replace(axis, condition=(kinds.name, kind))
        for kind, part in parts.items()
        for name, axis in part.axes.items()
    }
    return Part(object, "", {}, {kinds.name: kinds} | axes, good, parts, (section,))


def _entry(section: str, raw: Raw, place: Path, of_several: bool, report: Report) -> Part | None:
    """Read an entry of a choice; None if its kind is unknown."""
    kind = raw.get("kind") if isinstance(raw, dict) else raw
    if not isinstance(raw, str | dict):
        text = f"{dotted(place)} must be the name of a component, or a mapping with a kind, got {echo(raw)}"
        report(place, text)
        return None
    path: Path = (section, kind) if of_several and isinstance(kind, str) else (section,)
    return component(path, raw, lambda below, text: report((*place, *below[len(path) :]), text))


def test_file(data: Part, raw: Raw, report: Report) -> Part:
    """Read `test`: keys that differ from those of `data`."""
    if isinstance(raw, dict) and "kind" in raw:
        if raw["kind"] != data.kind:
            text = f"test.kind must equal data.kind, {data.kind}, got {echo(raw['kind'])}"
            report(("test", "kind"), text)
        raw = {key: value for key, value in raw.items() if key != "kind"}
    values, good = read_fields(data.cls, raw, ("test",), report, read_fixed, has_defaults=False)
    return Part(data.cls, "", values, {}, good)


def _with_name(part: Part) -> Part:
    """Return section `task`; without a name it is called after the columns of its target."""
    if not part.good or part.values["name"]:
        return part
    axis = part.axes.get("task.target")
    targets = (part.values["target"],) if axis is None else axis.values or ()
    several = len(targets) > 1
    name = "target" if several else target_name(targets[0], joint=part.values.get("joint", False))
    return dataclasses.replace(part, values=part.values | {"name": name})


def target_name(target: Raw, *, joint: bool) -> str:
    """Return the name of a target: its columns, joined by + if each is reported too, else by |."""
    return ("+" if joint else "|").join(target_columns(target))


def target_columns(target: Raw) -> tuple[str, ...]:
    """Return the columns of a target, as it is read or as an axis holds it."""
    entries = target if isinstance(target, tuple | list) else (target,)
    return tuple(str(x["column"] if isinstance(x, Mapping) else getattr(x, "column", x)) for x in entries)


def read_fixed(value: Raw, hint: Hint, rule: Rule, path: Path, report: Report) -> Any:
    """Read a value where no axis may stand."""
    if is_axis(value) and "mapping" not in expected(hint):
        report(path, f"{dotted(path)} cannot be an axis; it must be {expected(hint)}")
        return INVALID
    return read(value, hint, rule, path, report)


def read_or_axis(value: Raw, hint: Hint, rule: Rule, path: Path, report: Report) -> Any:
    """Read a value, or an axis of such values unless the key's rule forbids it."""
    if not is_axis(value) or not rule.axis:
        return read_fixed(value, hint, rule, path, report)
    assert isinstance(value, dict)  # so it is an axis
    return parse_axis(value, hint, path, report, lambda inner, where: read(inner, hint, rule, where, report))


def _apart(path: Path, cls: type, kind: str, values: Values, good: bool, report: Report) -> Part:
    """Return a part with its axes apart from its values; the class must accept them together."""
    varied = _conditioned(cls, {key: value for key, value in values.items() if isinstance(value, Axis)})
    fixed = {key: value for key, value in values.items() if key not in varied}
    part = Part(cls, kind, fixed, {axis.name: axis for axis in varied.values()}, good, path=path)
    messages = part.refusals() if good else []
    for message in messages:
        report(*blamed(message, values, path))
    return dataclasses.replace(part, good=False) if messages else part


def _conditioned(cls: type, varied: dict[str, Axis]) -> dict[str, Axis]:
    """Return axes, those of keys that only some components of another axis have with that condition."""
    conditions: dict[str, tuple[str, ...]] = {}
    for one in dataclasses.fields(cls):
        rule, axis = rule_of(one), varied.get(one.name)
        if not rule.component or axis is None:
            continue
        keys = {name: keys_of(named, {}) for name, named in components_named(axis, rule).items()}
        for key in set().union(*keys.values()):
            having = tuple(name for name, own in keys.items() if key in own)
            if len(having) < len(keys):
                conditions[key] = (axis.name, *having)
    return {
        key: dataclasses.replace(axis, condition=conditions.get(key, axis.condition))
        for key, axis in varied.items()
    }
