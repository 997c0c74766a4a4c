"""Which class says what each section of a search space may hold.

`data`, `encoder` and `model` hold one component of a package, named by `kind`; the other sections
are one dataclass each. Everything is imported when it is asked for.
"""

from __future__ import annotations

import importlib
import typing
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from dse import registry
from dse.config.device import DEVICES
from dse.registry import param

# Sections whose component may be an axis.
FAMILIES = ("encoder", "model")
COMPONENTS = {"data": "recordings", "encoder": "encoders", "model": "models"}
_SETTINGS = {
    "task": "dse.config.sections:Task",
    "window": "dse.recordings.windows:Window",
    "split": "dse.recordings.splits:Split",
    "preprocessing": "dse.preprocessing:Preprocessing",
    "training": "dse.models.training:Training",
    "decision": "dse.config.sections:Decision",
    "precision": "dse.config.sections:Precision",
    "search": "dse.config.sections:Search",
    "execution": "dse.config.sections:ExecutionSettings",
}
# In the order of a file; `test` holds keys of `data`, `hardware` and `objectives` are lists of names.
SECTIONS = (
    *("data", "task", "window", "split", "test", "preprocessing", "encoder", "model", "training", "decision"),
    *("precision", "hardware", "objectives", "search", "execution"),
)
# Columns that only a hardware profile gives, and the objective that no search may see.
OF_HARDWARE = (
    *("energy_uj", "energy_uj_low", "energy_uj_high"),
    *("energy_dynamic_uj", "energy_static_uj", "energy_static_throttled_uj"),
    *("energy_throttled_uj", "energy_throttled_uj_low", "energy_throttled_uj_high"),
    *("idle_mw", "hardware_latency_ms", "latency_ms", "n_cores", "n_cores_high", "fits"),
)
HELD_BACK = "accuracy_test"
WITH_AXES = ("window", "preprocessing", "encoder", "model", "training", "task")


@dataclass(frozen=True)
class Column:
    """A label column as (part of) the target."""

    column: str = param(doc="name of a label column")
    abs: bool = param(False, doc="its absolute value")


@dataclass(frozen=True)
class Task:
    """What is predicted."""

    target: str | Column | tuple[str | Column, ...] = param(  # noqa: RUF009
        doc="a label column, `{column: name, abs: true}`, or a list of these: their combination"
    )
    joint: bool = param(
        False,
        doc="with a list of columns: also report each of them, and let models have a part for each",
        axis=False,
    )
    name: str = param("", doc="name of the task in tables; absent: the target's columns", axis=False)


@dataclass(frozen=True)
class Decision:
    """Grid of decision parameters; each is a value, a list, a choice or a stepped range. Never trained."""

    phi: int = param(0, doc="output spikes that must be exceeded before deciding", unit="spikes", low=0)
    theta: float = param(0.5, doc="smallest share of the leading class in them", low=0, high=1)


@dataclass(frozen=True)
class Precision:
    """Weights of fewer bits, and fewer weights, of trained spiking networks. Never trained; absent: none."""

    weight_bits: tuple[int, ...] = param(
        doc="bits per weight, with a scale per layer; 8 is what is trained",
        unit="bits",
        low=2,
        high=8,
        axis=False,
    )
    pruned: tuple[float, ...] = param(
        (0.0,),
        doc="share of every matrix removed by magnitude after training",
        low=0,
        high=1,
        high_open=True,
        axis=False,
    )
    within: float = param(
        0.02,
        doc="accuracy that a design may lie below the front of its task and family to be evaluated still",
        low=0,
        high=1,
        axis=False,
    )


@dataclass(frozen=True)
class Search:
    """How designs are proposed and how often each is trained. A sampler adds its own keys."""

    sampler: str = param(
        "", doc="component of search.samplers; absent: grid where every axis has a step, else tpe", axis=False
    )
    n_trials: int | None = param(None, doc="designs to train; absent: the whole grid", low=1, axis=False)
    batch: int | None = param(
        None,
        doc="designs proposed at a time; absent: the whole grid for sampler grid, else 8",
        low=1,
        axis=False,
    )
    repeats: int | None = param(
        None,
        doc="trainings of every design, each with its own seed; absent: 1, or one per fold of split.k_fold",
        low=1,
        axis=False,
    )
    repeats_on_front: int = param(
        1, doc="trainings of the designs on the front of each task and family", low=1, axis=False
    )


@dataclass(frozen=True)
class ExecutionSettings:
    """How the work is spread; but for the rounding of another device it changes no result."""

    jobs: int = param(1, doc="processes at a time", low=1, axis=False)
    threads: int = param(
        1, doc="threads of each process on the CPU; they share the samples of a batch", low=1, axis=False
    )
    device: str = param(
        "cpu", choices=DEVICES, doc="what trains; with cuda all processes share the first GPU", axis=False
    )
    memory_gib: float | None = param(
        None,
        doc="memory of the device that each process may take; a design that needs more is not trained; "
        "absent: three quarters of all there is, divided by jobs",
        unit="GiB",
        low=0,
        low_open=True,
        axis=False,
    )


def settings_class(section: str) -> type:
    """Return the dataclass of a section that has no `kind`."""
    module, name = _SETTINGS[section].split(":")
    return typing.cast(type, getattr(importlib.import_module(module), name))


def components(section: str) -> dict[str, type]:
    """Return the components that `kind` of a section may name."""
    return registry.known(COMPONENTS[section])


def known_objectives() -> Mapping[str, Any]:
    """Return the objectives by name; each has a `direction`, 'max' or 'min'."""
    return typing.cast(Mapping[str, Any], importlib.import_module("dse.measure.objectives").known())


def front_end(recordings: type[Any]) -> str | None:
    """Return the section that what a recordings component reads cannot do without; None for spikes.

    Signals need an encoder and events preprocessing; spikes, and events once they are counted, may have an
    encoder as well.
    """
    hint = typing.get_type_hints(recordings.read)["return"]
    found = {_front_end(kind) for kind in typing.get_args(hint) or (hint,)}
    if len(found) > 1:
        raise TypeError(f"{recordings.__name__}.read must return recordings of one kind, got {hint}")
    return found.pop()


def _front_end(kind: type[Any]) -> str | None:
    """Return the section for one kind of recordings; what yields `blocks` is a source of events."""
    if hasattr(kind, "blocks"):
        return "preprocessing"
    return "encoder" if kind.__name__ == "Signals" else None
