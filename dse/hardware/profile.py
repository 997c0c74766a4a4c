"""Hardware profiles: numbers with a pedigree, read from YAML and checked.

A profile names its kind (`dse.hardware.kinds`), which says what numbers it holds and what they mean.
"""

from __future__ import annotations

import dataclasses
import functools
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from dse import registry, seeds
from dse.config.faults import ConfigError, Fault, known_names
from dse.config.locate import hardware_names, names_a_file, shipped_profiles
from dse.config.yaml_lines import Document, parse
from dse.hardware.plan import NotApplicable, Plan
from dse.records import Floats, Operations, Workload

KINDS = "hardware.kinds"

Evidence = Literal[
    "measured",
    "fitted",
    "vendor",
    "specification",
    "convention",
    "pre-silicon",
    "second-hand",
    "memory",
    "assumption",
]
End = Literal["low", "value", "high"]

Figures = Mapping[str, Floats]
"""Number by name, each () or (D,): D draws, or D ends of its range."""


@dataclass(frozen=True)
class Number:
    """One figure: value, range, unit, where it is from and how far it can be trusted."""

    value: float
    low: float
    high: float
    unit: str
    evidence: Evidence
    source: str


@dataclass(frozen=True)
class Figure:
    """What a number of a profile must be.

    unit: '1' for counts and ratios.
    whole: one whole number >= 1, without a range.
    claim: 0 or 1, without a range.
    """

    unit: str
    doc: str
    whole: bool = False
    claim: bool = False

    @property
    def fixed(self) -> bool:
        return self.whole or self.claim


def figure(unit: str, doc: str, *, whole: bool = False, claim: bool = False) -> Any:
    """Declare a number of a kind of hardware (arguments of `Figure`)."""
    return dataclasses.field(metadata={"figure": Figure(unit, doc, whole, claim)})


@dataclass(frozen=True)
class Profile(ABC):
    """One chip. A kind of hardware is a subclass whose other fields are declared by `figure`.

    name, doc: what it is called and what it is.
    interval_only: nobody has published numbers for it, so a cost is a range and no value.
    text: the file that it was read from, for a study to keep.
    """

    name: str
    doc: str
    interval_only: bool
    text: str = dataclasses.field(repr=False)

    @classmethod
    def numbers(cls) -> Mapping[str, Figure]:
        """Return what the numbers of this kind must be, by name."""
        return {f.name: f.metadata["figure"] for f in dataclasses.fields(cls) if "figure" in f.metadata}

    def at(self, end: End) -> dict[str, float]:
        """Return every number at one end of its range, by name."""
        return {name: getattr(getattr(self, name), end) for name in self.numbers()}

    @functools.cached_property
    def ends(self) -> Figures:
        """Every number at its value, its low and its high end, (3,) each."""
        at = [self.at(end) for end in ("value", "low", "high")]
        found = {name: np.array([values[name] for values in at]) for name in self.numbers()}
        for values in found.values():
            values.setflags(write=False)
        return found

    def drawn(self, n: int, rng: np.random.Generator) -> Figures:
        """Return every number n times, (n,) each, drawn from its range.

        Half of the draws are evenly spread below the value and half above, so the value is the median and
        nothing lies outside the range. Numbers are drawn independently of each other: an error that all
        share ranks no design above another, so it is the ratios between numbers that matter.
        """
        found = {}
        for name in self.numbers():
            number: Number = getattr(self, name)
            u = rng.random(n)
            below = number.low + 2 * u * (number.value - number.low)
            above = number.value + (2 * u - 1) * (number.high - number.value)
            found[name] = np.where(u < 0.5, below, above)
        return found

    def draws(self, n: int) -> Figures:
        """Return every number n times (`drawn`), the same at every call: designs compare on the same draw."""
        return self.drawn(n, seeds.generator(0, {"hardware": self.name}, "figures"))

    def plan(self, load: Workload | Operations, figures: Figures) -> Plan:
        """Return what one inference costs per count of what happens in it.

        Raises:
            NotApplicable: the chip cannot run such a classifier.
        """
        if isinstance(load, Workload):
            return self.plan_network(load, figures)
        return self.plan_operations(load, figures)

    @abstractmethod
    def plan_network(self, load: Workload, figures: Figures) -> Plan:
        """Return the plan of a network of spiking layers (`plan`)."""

    def plan_operations(self, load: Operations, figures: Figures) -> Plan:
        """Return the plan of any other classifier (`plan`); most chips can run none.

        Raises:
            NotApplicable: the chip cannot run such a classifier.
        """
        raise NotApplicable(f"{self.name} runs only networks of spiking layers")

    def pipeline_steps(self, load: Workload) -> int:
        """Return the steps that the last step's answer still takes through the layers; 0 on most chips."""
        return 0


_KEYS = tuple(field.name for field in dataclasses.fields(Number))
_OWN = ("name", "kind", "doc", "interval_only")


def names() -> list[str]:
    """Return the names of the shipped profiles."""
    return hardware_names()


def kinds() -> dict[str, type[Profile]]:
    """Return the kinds of hardware by name."""
    return registry.known(KINDS)


def load(name: str | Path) -> Profile:
    """Read a profile by the name of one that the package holds, or from a file.

    Raises:
        ConfigError: no such profile, or everything that is wrong with the file.
    """
    if isinstance(name, str) and name in names():
        return _packaged(name)
    try:
        text = Path(name).read_text(encoding="utf-8")
    except FileNotFoundError:
        known = known_names(str(name), names())
        raise ConfigError([Fault(str(name), 0, f"no such hardware profile; {known}")]) from None
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "is not UTF-8 text"
        raise ConfigError([Fault(str(name), 0, f"cannot be read: {reason}")]) from None
    found = read(text, str(name))
    if found.name in names():
        text = f"name must differ from the names of shipped profiles, got '{found.name}'"
        raise ConfigError([Fault(str(name), 0, text)])
    return found


def load_all(entries: Sequence[str], base: Path) -> tuple[Profile, ...]:
    """Read the profiles that a search space names.

    Args:
        entries: names of the package's profiles, or files.
        base: what files lie beside.

    Raises:
        ConfigError: everything that is wrong with any of them, two of one name included.
    """
    found: dict[str, Profile] = {}
    faults: list[Fault] = []
    for entry in entries:
        try:
            profile = load(entry if entry in names() else base / entry)
        except ConfigError as error:
            faults += error.faults
            continue
        if profile.name in found:
            faults.append(Fault(str(base / entry), 0, f"another profile has the name '{profile.name}' too"))
        found[profile.name] = profile
    if faults:
        raise ConfigError(faults)
    return tuple(found.values())


@functools.cache
def _packaged(name: str) -> Profile:
    return read(shipped_profiles()[name].read_text(encoding="utf-8"), f"{name}.yaml")


def read(text: str, source: str) -> Profile:
    """Read a profile.

    Args:
        text: YAML.
        source: what faults call the file.

    Raises:
        ConfigError: everything that is wrong with it.
    """
    document = parse(text, source)
    faults, cls = list(document.faults), None
    if not faults:
        faults, cls = _faults(document)
    if faults or cls is None:
        raise ConfigError(faults)
    data = document.data
    numbers = {key: Number(**data[key]) for key in cls.numbers()}
    interval_only = data.get("interval_only", False)
    return cls(name=data["name"], doc=data["doc"], interval_only=interval_only, text=text, **numbers)


def _faults(document: Document) -> tuple[list[Fault], type[Profile] | None]:
    """Return everything that is wrong, in the order of the file, and the kind of the profile."""
    data = document.data
    if not isinstance(data, dict):
        return [document.fault((), "a profile must be a mapping of names to numbers")], None
    known = kinds()
    kind = data.get("kind")
    if not isinstance(kind, str) or kind not in known:
        if "kind" not in data:
            return [document.fault((), f"kind is missing; {known_names('', known)}")], None
        text = f"unknown kind of hardware {kind!r}; {known_names(str(kind), known)}"
        return [document.fault(("kind",), text)], None
    numbers = known[kind].numbers()
    expected = (*_OWN, *numbers)
    found = []
    for key, given in data.items():
        if key not in expected:
            found.append(document.fault((key,), f"unknown number '{key}'; {known_names(str(key), expected)}"))
        elif key in numbers:
            found += [document.fault((key,), message) for message in _number_faults(key, numbers[key], given)]
        elif key == "interval_only":
            if not isinstance(given, bool):
                found.append(document.fault((key,), f"interval_only must be true or false, got {given!r}"))
        elif not isinstance(given, str) or not given:
            found.append(document.fault((key,), f"{key} must be text, got {given!r}"))
        elif key == "name" and not names_a_file(given):
            found.append(document.fault((key,), f"name must be valid as a file name, got {given!r}"))
    missing = [key for key in expected if key not in data and key != "interval_only"]
    return found + [document.fault((), f"{key} is missing") for key in missing], known[kind]


def _finite(x: Any) -> bool:
    try:
        return isinstance(x, int | float) and not isinstance(x, bool) and isfinite(x)
    except OverflowError:  # an integer that no float holds
        return False


def _number_faults(key: str, figure: Figure, given: Any) -> list[str]:
    if not isinstance(given, Mapping):
        return [f"{key} must hold exactly {', '.join(_KEYS)}, got {given!r}"]
    messages = [
        f"{key}: unknown '{name}'; {known_names(str(name), _KEYS)}" for name in given if name not in _KEYS
    ]
    messages += [f"{key}.{name} is missing" for name in _KEYS if name not in given]
    if "unit" in given and given["unit"] != figure.unit:
        messages.append(f"{key}.unit must be '{figure.unit}', got {given['unit']!r}")
    if "evidence" in given and given["evidence"] not in get_args(Evidence):
        known = known_names(str(given["evidence"]), get_args(Evidence))
        messages.append(f"{key}.evidence is unknown, got {given['evidence']!r}; {known}")
    if "source" in given and (not isinstance(given["source"], str) or not given["source"]):
        messages.append(f"{key}.source must state the source of the number, got {given['source']!r}")
    if not set(get_args(End)) <= set(given):
        return messages
    ends = [given[end] for end in get_args(End)]
    if not all(map(_finite, ends)):
        messages.append(f"{key}: low, value and high must be finite numbers, got {ends}")
    elif not 0 <= ends[0] <= ends[1] <= ends[2]:
        messages.append(f"{key} must be 0 <= low <= value <= high, got {ends}")
    elif figure.whole and (ends[0] != ends[2] or ends[1] < 1 or ends[1] != int(ends[1])):
        messages.append(f"{key} must be one integer >= 1, equal to low and high, got {ends}")
    elif figure.claim and (ends[0] != ends[2] or ends[1] not in (0, 1)):
        messages.append(f"{key} must be 0 or 1, equal to low and high, got {ends}")
    return messages
