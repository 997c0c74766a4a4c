"""Hardware profiles: numbers with a pedigree, read from YAML and checked.

A profile names its kind (`dse.measure.hardware.kinds`), which says what numbers it holds and what they mean.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal, get_args

import numpy as np

from dse.base import registry, seeds
from dse.base.records import Floats, Operations, Workload
from dse.base.registry import param
from dse.config.faults import ConfigError, Fault, known_names
from dse.config.locate import names_a_file, shipped_profiles
from dse.config.parts import Chip, KeyFault, Written, whole_profile
from dse.config.settings import Schedule
from dse.config.space import SearchSpace
from dse.config.values import Report, echo, read_fields
from dse.config.yaml_lines import Document, Raw, dump, parse
from dse.measure.hardware.plan import Misfit, NotApplicable, Plan

KINDS = "hardware.kinds"
_DELAYS = ("max_delay", "max_axonal_delay")
"""Keys of models that give synapses delays of their own."""

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
    optional: a profile may lack it.
    """

    unit: str
    doc: str
    whole: bool = False
    claim: bool = False
    optional: bool = False

    @property
    def fixed(self) -> bool:
        return self.whole or self.claim


def figure(unit: str, doc: str, *, whole: bool = False, claim: bool = False, optional: bool = False) -> Any:
    """Declare a number of a kind of hardware (arguments of `Figure`); optional ones come last."""
    default = None if optional else dataclasses.MISSING
    return dataclasses.field(default=default, metadata={"figure": Figure(unit, doc, whole, claim, optional)})


def count(doc: str, *, optional: bool = False) -> Any:
    """Declare a whole number of a kind of hardware, >= 1 and without a range."""
    return figure("1", doc, whole=True, optional=optional)


def optional(doc: str) -> Any:
    """Declare a number without a unit that a profile may lack."""
    return figure("1", doc, optional=True)


def claim(doc: str) -> Any:
    """Declare what a profile says yes (1) or no (0) to."""
    return figure("1", doc, claim=True)


@dataclass(frozen=True)
class Profile(ABC):
    """One chip. A kind of hardware is a subclass whose other fields are declared by `figure`.

    name, doc: what it is called and what it is.
    interval_only: nobody has published numbers for it, so a cost is a range and no value.
    text: the file that it was read from, for a study to keep.
    programmable: whether its neurons run programs, so that it runs resonators too.
    schedule: on which it answers; None: what an answer costs is all that is asked.
    label: what readers call it; '' for its name.
    target: target that runs on it, whose cycles it predicts; '' for none.
    compiler: that makes the code of the target.
    any_neuron: whether all profiles of this kind run any neurons: processors and conventions.
    delays_synapses: whether profiles of this kind may give synapses delays of their own.
    """

    name: str
    doc: str
    interval_only: bool
    text: str = dataclasses.field(repr=False)
    programmable: bool = dataclasses.field(default=False, kw_only=True)
    schedule: Schedule | None = dataclasses.field(default=None, kw_only=True)
    label: str = dataclasses.field(default="", kw_only=True)
    target: str = dataclasses.field(default="", kw_only=True)
    compiler: str = dataclasses.field(default="clang", kw_only=True)

    any_neuron: ClassVar[bool] = False
    delays_synapses: ClassVar[bool] = True

    @classmethod
    def faults(cls, chip: Chip, space: Written) -> Iterator[KeyFault]:
        """Yield why a chip of this kind runs no design of a search space: neurons, or delays of synapses."""
        models, known = space.each("model"), registry.known("neurons")
        if not (models and space.parts["model"].good):
            return
        where, name = ("hardware", chip.place), f"hardware '{chip.name}'"
        neurons = [part.components("neurons") for part in models]
        needed = list(dict.fromkeys(itertools.chain(*neurons)))
        programmed = all(getattr(known[x], "programmed", False) for x in needed)
        if all(neurons) and programmed and chip.is_fixed:
            yield where, f"{name} cannot run neuron {' or '.join(needed)}: its neurons cannot be programmed"
        least = [max((min(part.range(key) or (0,)), key) for key in _DELAYS) for part in models]
        if not cls.delays_synapses and all(delay for delay, _ in least):
            yield where, f"{name} cannot delay synapses (model.{min(least)[1]} {min(least)[0]})"

    @classmethod
    def numbers(cls) -> Mapping[str, Figure]:
        """Return what the numbers of this kind must be, by name."""
        return {f.name: f.metadata["figure"] for f in dataclasses.fields(cls) if "figure" in f.metadata}

    @property
    def stated(self) -> tuple[str, ...]:
        """Names of the numbers that this profile has."""
        return tuple(name for name in self.numbers() if getattr(self, name) is not None)

    def at(self, end: End) -> dict[str, float]:
        """Return every number at one end of its range, by name."""
        return {name: getattr(getattr(self, name), end) for name in self.stated}

    @functools.cached_property
    def ends(self) -> Figures:
        """Every number at its value, its low and its high end, (3,) each."""
        at = [self.at(end) for end in ("value", "low", "high")]
        figures = {name: np.array([values[name] for values in at]) for name in self.stated}
        for values in figures.values():
            values.setflags(write=False)
        return figures

    def drawn(self, n: int, rng: np.random.Generator) -> Figures:
        """Return every number n times, (n,) each, drawn from its range.

        Half of the draws are evenly spread below the value and half above, so the value is the median and
        nothing lies outside the range. Numbers are drawn independently of each other: an error that all
        share ranks no design above another, so it is the ratios between numbers that matter.
        """
        figures = {}
        for name in self.stated:
            number: Number = getattr(self, name)
            u = rng.random(n)
            below = number.low + 2 * u * (number.value - number.low)
            above = number.value + (2 * u - 1) * (number.high - number.value)
            figures[name] = np.where(u < 0.5, below, above)
        return figures

    def draws(self, n: int) -> Figures:
        """Return every number n times (`drawn`), the same at every call: designs compare on the same draw."""
        return self.drawn(n, seeds.generator(0, {"hardware": self.name}, "figures"))

    def plan(self, load: Workload | Operations, figures: Figures) -> Plan:
        """Return what one inference costs per count of what happens in it.

        Raises:
            NotApplicable: the chip cannot run such a classifier.
        """
        if isinstance(load, Workload):
            if load.n_resonators and not (self.programmable or self.any_neuron):
                raise NotApplicable(f"{self.name} cannot run resonators: its neurons cannot be programmed")
            return self.plan_network(load, figures)
        return self.plan_operations(load, figures)

    def counts(self, load: Workload | Operations) -> Floats:
        """Return what happens in an inference on this hardware, (..., F), which its plan has a cost for."""
        return load.counts

    @abstractmethod
    def plan_network(self, load: Workload, figures: Figures) -> Plan:
        """Return the plan of a network of spiking layers (`plan`)."""

    def plan_operations(self, load: Operations, figures: Figures) -> Plan:
        """Return the plan of any other classifier (`plan`); most chips can run none."""
        neurons = ", of neurons that it has figures for" if load.is_spiking else ""
        raise NotApplicable(f"{self.name} runs only networks of spiking layers{neurons}")

    def exceeded(self, needs: Iterable[tuple[str, int, str]], beside: str = "") -> list[Misfit]:
        """Return the misfits of whole numbers of the profile that a classifier needs more of.

        Args:
            needs: name of each number, how many are needed, and of what, in words.
            beside: ends the change that would fit.
        """
        numbers = [(rule, n, int(getattr(self, rule).value), what) for rule, n, what in needs]
        return [
            Misfit(rule, f"{needed} {what}, {most} at most", f"{most} {what}{beside}")
            for rule, needed, most, what in numbers
            if needed > most
        ]

    def pipeline_steps(self, load: Workload) -> int:
        """Return the steps that the last step's answer still takes through the layers; 0 on most chips."""
        return 0


def names() -> list[str]:
    """Return the names of the shipped profiles."""
    return list(shipped_profiles())


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
    profile = read(text, str(name))
    if profile.name in names():
        text = f"name must differ from the names of shipped profiles, got '{profile.name}'"
        raise ConfigError([Fault(str(name), 0, text)])
    return profile


def of_space(space: SearchSpace) -> tuple[Profile, ...]:
    """Read the profiles of a search space, on its schedule.

    Raises:
        ConfigError: as `load_all`.
    """
    chips = load_all(space.hardware, space.source.parent)
    return tuple(dataclasses.replace(chip, schedule=space.schedule) for chip in chips)


def load_all(entries: Sequence[str], base: Path) -> tuple[Profile, ...]:
    """Read profiles.

    Args:
        entries: names of the package's profiles, or files.
        base: what files lie beside.

    Raises:
        ConfigError: everything that is wrong with any of them, two of one name included.
    """
    profiles: dict[str, Profile] = {}
    faults: list[Fault] = []
    for entry in entries:
        try:
            profile = load(entry if entry in names() else base / entry)
        except ConfigError as error:
            faults += error.faults
            continue
        if profile.name in profiles:
            faults.append(Fault(str(base / entry), 0, f"another profile has the name '{profile.name}' too"))
        profiles[profile.name] = profile
    if faults:
        raise ConfigError(faults)
    return tuple(profiles.values())


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
    document.check()
    profile = _profile(document, text)
    document.check()
    assert profile is not None  # else there were faults
    return profile


@dataclass(frozen=True)
class _About:
    """The keys of a profile that are no numbers."""

    name: str = param(doc="name of the profile")
    kind: str = param(doc="kind of hardware")
    doc: str = param(doc="what it is")
    label: str = param("", doc="what readers call it (default: its name)")
    like: str = param("", doc="shipped profile that all other keys are taken from, but its name and label")
    interval_only: bool = param(False, doc="whether no values are published, so that a cost is a range")
    programmable: bool = param(False, doc="whether its neurons run programs, so that it runs resonators")
    target: str = param("", doc="target that runs on it: the cycles are of its code")
    compiler: Literal["clang", "gcc"] = param("clang", doc="compiler of that code")


def _profile(document: Document, text: str) -> Profile | None:
    """Return the profile of a file, or None after reporting everything that is wrong."""
    data, report = document.data, document.report
    if not isinstance(data, dict):
        report((), f"a profile must be a mapping of names to numbers, got {echo(data)}")
        return None
    if (like := data.get("like")) is not None:
        if not isinstance(like, str) or like not in names():
            report(("like",), f"unknown hardware profile {echo(like)}; {known_names(str(like), names())}")
            return None
        data = {key: value for key, value in whole_profile(data).items() if key != "like"}
        text = dump(data)
    cls = _kind(data, report)
    if cls is None:
        return None
    figures = cls.numbers()
    about, _ = read_fields(_About, data, (), report, also=figures)
    for key in ("name", "doc"):
        if data.get(key) == "":
            report((key,), f"{key} must not be empty")
    if (name := about.get("name")) and not names_a_file(name):
        report(("name",), f"name must be valid as a file name, got '{name}'")
    numbers: dict[str, Any] = {name: _number(name, figure, data, report) for name, figure in figures.items()}
    if document.faults:
        return None
    return cls(text=text, **{key: about[key] for key in about.keys() - {"kind", "like"}}, **numbers)


def _kind(data: Mapping[str, Raw], report: Report) -> type[Profile] | None:
    """Return the kind of hardware that a profile names."""
    known = kinds()
    kind = data.get("kind")
    if "kind" not in data:
        report((), f"kind is required; {known_names('', known)}")
    elif not isinstance(kind, str) or kind not in known:
        report(("kind",), f"unknown kind of hardware {echo(kind)}; {known_names(str(kind), known)}")
    else:
        return known[kind]
    return None


def _number(name: str, figure: Figure, data: Mapping[str, Raw], report: Report) -> Number | None:
    """Return a number of a profile, or None after reporting everything that is wrong with it."""
    if name not in data:
        if figure.optional:
            return None
        report((), f"{name} is required: {figure.doc}")
        return None
    values, good = read_fields(Number, data[name], (name,), report)
    if values.get("unit", figure.unit) != figure.unit:
        report((name, "unit"), f"{name}.unit must be '{figure.unit}', got '{values['unit']}'")
    if values.get("source") == "":
        report((name, "source"), f"{name}.source must state the source of the number, got ''")
    ends = [values[end] for end in get_args(End) if end in values]
    if len(ends) == len(get_args(End)) and (rule := _broken_rule(figure, *ends)):
        report((name,), f"{name} must be {rule}, got [{', '.join(f'{end:g}' for end in ends)}]")
    return Number(**values) if good else None


def _broken_rule(figure: Figure, low: float, value: float, high: float) -> str:
    """Return the rule that a number's value and range break; '' where they break none."""
    if not 0 <= low <= value <= high:
        return "0 <= low <= value <= high"
    if figure.whole and not (low == high and value >= 1 and value == int(value)):
        return "one integer >= 1, equal to low and high"
    if figure.claim and not (low == high and value in (0, 1)):
        return "0 or 1, equal to low and high"
    return ""
