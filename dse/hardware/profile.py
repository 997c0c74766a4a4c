"""Hardware profiles: numbers with a pedigree, read from YAML and checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from importlib import resources
from math import isfinite
from pathlib import Path
from typing import Any, Literal, get_args

from dse.config.faults import ConfigError, Fault, known_names
from dse.config.yaml_lines import Document, parse

Evidence = Literal[
    "measured", "fitted", "vendor", "specification", "convention", "pre-silicon", "memory", "assumption"
]
End = Literal["low", "value", "high"]


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
class Profile:
    """The figures of one chip of Loihi's kind; the suffix of a field is its unit.

    neuron_access, neuron_update, spike, synaptic_event, message, hop: energy and time per event.
    barrier_<n>_us: synchronisation of a step from n tiles in use on.
    congestion_factor: times a step where more than `congestion_spikes` spikes of a layer go to
        `congestion_cores` cores or more.
    static_mw: static power of the whole chip.
    skips_zero_weights: 1 where a weight of 0 need not be stored and takes no synaptic event, else 0.
    """

    name: str
    doc: str
    neuron_access_pj: Number
    neuron_update_pj: Number
    spike_pj: Number
    synaptic_event_pj: Number
    message_pj: Number
    hop_x_pj: Number
    hop_y_pj: Number
    neuron_access_ns: Number
    neuron_update_ns: Number
    spike_ns: Number
    synaptic_event_ns: Number
    message_out_ns: Number
    message_in_ns: Number
    barrier_1_us: Number
    barrier_2_us: Number
    barrier_4_us: Number
    barrier_29_us: Number
    congestion_factor: Number
    congestion_spikes: Number
    congestion_cores: Number
    static_mw: Number
    cores: Number
    cores_per_tile: Number
    mesh_height: Number
    neurons_per_core: Number
    synapse_memory_bits: Number
    input_axons_per_core: Number
    output_axons_per_core: Number
    skips_zero_weights: Number

    def at(self, end: End) -> dict[str, float]:
        """Return every number at one end of its range, by name."""
        return {name: getattr(getattr(self, name), end) for name in _numbers_of(Profile)}


@dataclass(frozen=True)
class OperationProfile:
    """Figures per operation of any classifier: computing alone, without memory, static power, cores or time.

    mac: a multiply-accumulate. addition: an accumulation without multiplication, such as a spike's weight.
    """

    name: str
    doc: str
    mac_pj: Number
    addition_pj: Number


def _numbers_of(kind: type[Profile | OperationProfile]) -> tuple[str, ...]:
    return tuple(field.name for field in fields(kind) if field.type == "Number")


_KEYS = tuple(field.name for field in fields(Number))
_SPELLED = {"pj": "pJ", "ns": "ns", "us": "us", "mw": "mW"}
_COUNTS = (
    "cores",
    "cores_per_tile",
    "mesh_height",
    "neurons_per_core",
    "synapse_memory_bits",
    "input_axons_per_core",
    "output_axons_per_core",
)


def names() -> list[str]:
    """Return the names of the profiles that the package holds."""
    folder = resources.files("dse.hardware") / "profiles"
    return sorted(
        entry.name.removesuffix(".yaml") for entry in folder.iterdir() if entry.name.endswith(".yaml")
    )


def load(name: str | Path) -> Profile | OperationProfile:
    """Read a profile by the name of one that the package holds, or from a file; its keys say of which kind.

    Raises:
        ConfigError: no such profile, or everything that is wrong with the file.
    """
    if isinstance(name, str) and name in names():
        source = f"{name}.yaml"
        text = (resources.files("dse.hardware") / "profiles" / source).read_text(encoding="utf-8")
    else:
        source = str(name)
        try:
            text = Path(name).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError):
            raise ConfigError(
                [Fault(source, 0, f"no hardware profile; {known_names(source, names())}")]
            ) from None
    document = parse(text, source)
    by_operation = isinstance(document.data, dict) and not {"mac_pj", "addition_pj"}.isdisjoint(document.data)
    kind = OperationProfile if by_operation else Profile
    faults = document.faults or _faults(document, _numbers_of(kind))
    if faults:
        raise ConfigError(faults)
    numbers = {key: Number(**document.data[key]) for key in _numbers_of(kind)}
    return kind(name=document.data["name"], doc=document.data["doc"], **numbers)


def _faults(document: Document, numbers: tuple[str, ...]) -> list[Fault]:
    """Return everything that is wrong, in the order of the file."""
    if not isinstance(document.data, dict):
        return [document.fault((), "a profile must be a mapping of names to numbers")]
    expected = ("name", "doc", *numbers)
    found = []
    for key, given in document.data.items():
        if key not in expected:
            found.append(document.fault((key,), f"unknown number '{key}'; {known_names(key, expected)}"))
        elif key in numbers:
            found += [document.fault((key,), message) for message in _number_faults(key, given)]
        elif not isinstance(given, str) or not given:
            found.append(document.fault((key,), f"{key} must be text, got {given!r}"))
    missing = [key for key in expected if key not in document.data]
    return found + [document.fault((), f"{key} is missing") for key in missing]


def _number_faults(key: str, given: Any) -> list[str]:
    if not isinstance(given, Mapping) or set(given) != set(_KEYS):
        return [f"{key} must hold exactly {', '.join(_KEYS)}, got {given!r}"]
    messages = []
    unit = _SPELLED.get(key.rsplit("_", 1)[-1], "1")
    if given["unit"] != unit:
        messages.append(f"{key}.unit must be '{unit}', got {given['unit']!r}")
    if given["evidence"] not in get_args(Evidence):
        known = known_names(str(given["evidence"]), get_args(Evidence))
        messages.append(f"{key}.evidence is unknown, got {given['evidence']!r}; {known}")
    if not isinstance(given["source"], str) or not given["source"]:
        messages.append(f"{key}.source must say where the number is from, got {given['source']!r}")
    ends = [given[end] for end in get_args(End)]
    if any(isinstance(x, bool) or not isinstance(x, int | float) or not isfinite(x) for x in ends):
        messages.append(f"{key}: low, value and high must be finite numbers, got {ends}")
    elif not 0 <= ends[0] <= ends[1] <= ends[2]:
        messages.append(f"{key} must be 0 <= low <= value <= high, got {ends}")
    elif key in _COUNTS and (ends[0] != ends[2] or ends[1] < 1 or ends[1] != int(ends[1])):
        messages.append(f"{key} must be one whole number >= 1, the same as low and high, got {ends}")
    elif key == "skips_zero_weights" and (ends[0] != ends[2] or ends[1] not in (0, 1)):
        messages.append(f"{key} must be 0 or 1, the same as low and high, got {ends}")
    return messages
