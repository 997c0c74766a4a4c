"""Key `training.teacher`: the family that it names, and what may be wrong with it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from dse import registry
from dse.config.contracts import Teacher
from dse.config.faults import known_names
from dse.config.parts import Part, read_fixed
from dse.config.settings import Training
from dse.config.values import echo, read_object
from dse.config.yaml_lines import Path, Raw

_KEY = ("training", "teacher")


def teacher_of(training: Training) -> Teacher | None:
    """Return the family that a training learns from; None: from labels alone.

    Raises:
        ValueError: no family of that name can teach, or it refuses its keys.
    """
    if training.teacher is None or not training.teacher_weight:
        return None
    faults: list[tuple[Path, str]] = []
    teacher = _read(training.teacher, _KEY, faults)
    if teacher is None:
        raise ValueError(faults[0][1])
    return teacher


def teacher_faults(training: Part) -> Iterator[tuple[Path, str]]:
    """Yield (path, sentence) for every fault of the teachers that section `training` names."""
    faults: list[tuple[Path, str]] = []
    axis = training.axes.get("training.teacher")
    if axis is None:
        _read(training.values.get("teacher"), _KEY, faults)
    else:
        for index, value in enumerate(axis.values or ()):
            _read(value, (*_KEY, "choice", index), faults)
    yield from faults


def _read(written: Raw, path: Path, faults: list[tuple[Path, str]]) -> Teacher | None:
    """Return the family that a name, or a mapping with a kind, stands for; None: nothing, or at fault."""
    if written is None:
        return None
    keys: Mapping[str, Raw] = {"kind": written} if isinstance(written, str) else written  # type: ignore[assignment]
    families: dict[str, Any] = registry.known("models")
    teachers = {name: cls for name, cls in families.items() if hasattr(cls, "scores")}
    kind = keys.get("kind")
    at = path if isinstance(written, str) or "kind" not in keys else (*path, "kind")
    if kind is None:
        faults.append((at, f"training.teacher must have a kind: {', '.join(teachers)}"))
    elif not isinstance(kind, str) or kind not in families:
        faults.append((at, f"unknown training.teacher {echo(kind)}; {known_names(str(kind), teachers)}"))
    elif kind not in teachers:
        known = ", ".join(teachers)
        faults.append((at, f"training.teacher must give probabilities of classes ({known}), got {kind}"))
    else:
        own = {key: value for key, value in keys.items() if key != "kind"}
        report = lambda where, text: faults.append((where, text))  # noqa: E731
        return read_object(teachers[kind], own, path, report, read_fixed)
    return None
