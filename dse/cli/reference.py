"""What a search space may hold, as rows: read from the components themselves, so it cannot be out of date."""

from __future__ import annotations

import dataclasses
import inspect
import typing
from typing import Any

from dse import registry
from dse.config.locate import hardware_names
from dse.config.sections import COMPONENTS, SECTIONS, WITH_AXES, known_objectives, settings_class
from dse.config.values import bounds, echo, wanted
from dse.registry import Rule, rule_of

Row = dict[str, Any]
_LISTS = {
    "hardware": "profiles of chips, for energy and latency",
    "objectives": "columns to minimise or maximise",
}
_SAMPLERS = "search.samplers"


def sections() -> list[Row]:
    """Return the sections of a search space: name and meaning."""
    docs = {
        "data": "the recordings; `kind` names a component",
        "test": "keys of data that differ for the recordings of a final test",
        "encoder": "sampled signals -> spikes; `kind` names a component",
        "model": "the classifier; `kind` names a component",
        **_LISTS,
    }
    listed = [{"section": name, "doc": docs.get(name) or _doc(settings_class(name))} for name in SECTIONS]
    return [*listed, {"section": _SAMPLERS, "doc": "how designs are proposed; named by search.sampler"}]


def names(section: str) -> list[Row]:
    """Return the components of a section, or the names that a list may hold; empty where it has neither."""
    if section == "objectives":
        return [
            {
                "name": name,
                "direction": found.direction,
                "unit": found.unit,
                "doc": f"{found.direction}: {found.doc}",
            }
            for name, found in known_objectives().items()
        ]
    if section == "hardware":
        from dse.hardware.profile import load

        return [{"name": name, "doc": load(name).doc} for name in hardware_names()]
    section = "data" if section == "test" else section
    package = _SAMPLERS if section == _SAMPLERS else COMPONENTS.get(section)
    return (
        [{"name": name, "doc": _doc(cls)} for name, cls in registry.known(package).items()] if package else []
    )


def keys(section: str, name: str | None) -> list[Row]:
    """Return the keys of a section or of a component: type, bounds, unit, default, meaning."""
    section = "data" if section == "test" else section
    if section == "hardware":
        from dse.hardware.profile import load

        numbers = {
            key: value for key, value in vars(load(str(name))).items() if dataclasses.is_dataclass(value)
        }
        return [{"key": key, **vars(number)} for key, number in numbers.items()]
    if section in _LISTS:
        return [row for row in names(section) if row["name"] == name]
    package = _SAMPLERS if section == _SAMPLERS else COMPONENTS.get(section)
    cls = registry.known(package)[str(name)] if package else settings_class(section)
    hints = typing.get_type_hints(cls)
    with_axes = section in WITH_AXES or section == "decision"
    return [
        _row(field, hints[field.name], rule_of(field), with_axes)
        for field in dataclasses.fields(cls)
        if field.init
    ]


def _row(field: dataclasses.Field[Any], hint: Any, rule: Rule, with_axes: bool) -> Row:
    default: Any = field.default
    if field.default_factory is not dataclasses.MISSING:
        default = field.default_factory()
    words, null, _ = wanted(hint).partition(" or null")
    must = " ".join(filter(None, [words, bounds(rule)])) + null
    if rule.choices:
        must = "one of " + ", ".join(map(str, rule.choices))
    return {
        "key": field.name,
        "must_be": must,
        "unit": rule.unit,
        "default": "required" if default is dataclasses.MISSING else echo(default),
        "axis": "yes" if with_axes and rule.axis else "no",
        "doc": rule.doc,
    }


def _doc(cls: type) -> str:
    return (inspect.getdoc(cls) or "").split("\n", 1)[0]
