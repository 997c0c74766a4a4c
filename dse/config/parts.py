"""One section of the file -> its values, with its axes apart; all rules of its class checked."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

from dse.config.axes import Axis, is_axis, parse_axis
from dse.config.faults import known_names
from dse.config.sections import WITH_AXES, Task, components, settings_class
from dse.config.values import INVALID, Report, dotted, echo, read, read_fields, read_given, wanted
from dse.config.yaml_lines import Path
from dse.registry import Rule

# Cross-field rules are tried on at most this many combinations of a section's own axes.
_MOST_COMBINATIONS = 1000


@dataclass(frozen=True)
class Part:
    """A section: key -> value, and dotted name -> axis for the keys that vary.

    good: nothing in it was at fault; otherwise the keys at fault are missing.
    """

    values: dict[str, Any]
    axes: dict[str, Axis]
    good: bool


def settings(section: str, raw: Any, report: Report) -> Part:
    """Read a section that is one dataclass."""
    cls = settings_class(section)
    one = read_or_axis if section in WITH_AXES else read_fixed
    return _apart(section, cls, *read_fields(cls, raw, (section,), report, one), report)


def component_class(section: str, raw: Any, report: Report) -> type | None:
    """Return the class that `kind` of a section names; None after a fault."""
    known = components(section)
    if not isinstance(raw, dict):
        report((section,), f"{section} must be a mapping with a kind, got {echo(raw)}")
    elif "kind" not in raw:
        report((section,), f"{section}.kind is required; {known_names('', known)}")
    elif not isinstance(raw["kind"], str) or raw["kind"] not in known:
        kind = raw["kind"]
        report((section, "kind"), f"unknown {section}.kind {echo(kind)}; {known_names(str(kind), known)}")
    else:
        return known[raw["kind"]]
    return None


def component(section: str, cls: type, raw: dict[str, Any], report: Report) -> Part:
    """Read a section with a `kind`, whose class is known."""
    keys = {key: value for key, value in raw.items() if key != "kind"}
    one = read_or_axis if section in WITH_AXES else read_fixed
    part = _apart(section, cls, *read_fields(cls, keys, (section,), report, one), report)
    return Part({"kind": raw["kind"]} | part.values, part.axes, part.good)


def test_file(cls: type, kind: str, raw: Any, report: Report) -> Part:
    """Read `test`: keys that differ from those of `data`."""
    if isinstance(raw, dict) and "kind" in raw:
        if raw["kind"] != kind:
            report(("test", "kind"), f"test.kind must be that of data, {kind}, got {echo(raw['kind'])}")
        raw = {key: value for key, value in raw.items() if key != "kind"}
    values, good = read_given(cls, raw, ("test",), report, read_fixed)
    return Part(values, {}, good)


def task(raw: Any, report: Report) -> Part:
    """Read `task`; without a name it is called after the columns of its target."""
    part = settings("task", raw, report)
    if not part.good or part.values["name"]:
        return part
    axis = part.axes.get("task.target")
    targets = (part.values["target"],) if axis is None else axis.values or ()
    name = _columns(targets[0]) if len(targets) == 1 else "target"
    return Part(part.values | {"name": name}, part.axes, part.good)


def read_fixed(value: Any, hint: Any, rule: Rule, path: Path, report: Report) -> Any:
    """Read a value where no axis may stand."""
    if is_axis(value) and "mapping" not in wanted(hint):
        report(path, f"{dotted(path)} cannot be an axis; it must be {wanted(hint)}")
        return INVALID
    return read(value, hint, rule, path, report)


def read_or_axis(value: Any, hint: Any, rule: Rule, path: Path, report: Report) -> Any:
    """Read a value, or an axis of such values unless the key's rule forbids it."""
    if not is_axis(value) or not rule.axis:
        return read_fixed(value, hint, rule, path, report)
    return parse_axis(value, hint, path, report, lambda inner, where: read(inner, hint, rule, where, report))


def _apart(section: str, cls: type, values: dict[str, Any], good: bool, report: Report) -> Part:
    """Return values and axes apart, after asking the class whether it accepts them together."""
    varied = {key: value for key, value in values.items() if isinstance(value, Axis)}
    plain = {key: value for key, value in values.items() if key not in varied}
    # Task is a reading aid of this package: nothing constructs it, and its columns are plain mappings.
    messages = _refusals(cls, plain, varied) if good and cls is not Task else []
    for message in messages:
        # A component's own sentence begins with the key that it is about.
        key = message.split(" ", 1)[0].removeprefix(f"{section}.")
        prefix = "" if message.startswith(section) else f"{section}." if key in values else f"{section}: "
        report((section, key) if key in values else (section,), prefix + message)
    return Part(plain, {axis.name: axis for axis in varied.values()}, good and not messages)


def _refusals(cls: type, plain: dict[str, Any], varied: dict[str, Axis]) -> list[str]:
    """Return what the class says against its values, tried at every corner of the section's axes."""
    extremes = [[axis.wrapped(value) for value in axis.extremes()] for axis in varied.values()]
    messages: dict[str, None] = {}
    for combination in itertools.islice(itertools.product(*extremes), _MOST_COMBINATIONS):
        try:
            cls(**plain | dict(zip(varied, combination, strict=True)))
        except ValueError as error:
            messages.setdefault(str(error))
    return list(messages)


def _columns(target: Any) -> str:
    parts = target if isinstance(target, tuple) else (target,)
    return "|".join(part["column"] if isinstance(part, dict) else part for part in parts)
