"""YAML file -> `SearchSpace`, or every fault in it at once."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dse.base import registry
from dse.base.registry import Plugin, Rule
from dse.config import names, parts, search
from dse.config.contracts import Source
from dse.config.faults import known_names
from dse.config.locate import find_file, names_a_file, shipped_spaces
from dse.config.parts import FAMILIES, Part, Written
from dse.config.resolved import SECTIONS, SETTINGS, front_end
from dse.config.space import DecisionGrid, SearchSpace
from dse.config.values import INVALID, Report, construct, echo, read
from dse.config.yaml_lines import Document, Raw, override, plain_document, read_document
from dse.config.yaml_lines import Path as Keys

REQUIRED = ("data", "task", "split", "model")
_WITH_DEFAULTS = ("window", "training", "decision", "search", "execution")
_OF_STUDY = ("decision", "precision", "schedule", "search", "execution")
_DECISION = {"phi": {"range": [0, 60], "step": 2}, "theta": {"range": [0.2, 1.0], "step": 0.05}}
_OBJECTIVES: tuple[tuple[str, str], ...] = (("accuracy", "max"), ("n_weights", "min"))
_ENERGY = ("energy_uj", "min")
_IN_PYTHON = "search space"  # where the faults of a mapping are
_LONGEST_NAME = 200  # bytes of a study's folder; files beside it while it is written have longer names


def load_space(
    path_or_name: str | Path | Mapping[str, Any],
    overrides: Mapping[str, str] | None = None,
    *,
    check_data: bool = False,
) -> SearchSpace:
    """Read and validate a search space.

    Args:
        path_or_name: a YAML file, the name of a search space that comes with the package, or its sections as
            a mapping; files that a mapping names are relative to the working folder.
        overrides: dotted key -> YAML text that replaces the file's value.
        check_data: also look for what a run needs: the data files, the arrays that the file names in
            them, and the device.

    Raises:
        ConfigError: with every fault of the file and of the overrides.
        TypeError: the space is neither text, path nor mapping.

    >>> dse.load_space("quickstart", {"model.hidden": "{choice: [20, 80]}"}).n_designs
    16
    """
    given: object = path_or_name
    if not isinstance(given, str | Path | Mapping):
        text = "a search space must be a YAML file, the name of a shipped one, or a mapping of its sections"
        raise TypeError(f"{text}, got {type(given).__name__}")
    if isinstance(path_or_name, Mapping):
        source = Path(_IN_PYTHON)
        document = override(plain_document(path_or_name, _IN_PYTHON), overrides or {})
    else:
        source = find_file(str(path_or_name), shipped_spaces(), "search space")
        document = read_document(source, overrides or {})
    space = _space(document, source, check_data) if document.data or not document.faults else None
    document.check()
    assert space is not None  # else there were faults
    return space


def _space(document: Document, source: Path, check_data: bool) -> SearchSpace | None:
    data, report = document.data, document.report
    if not isinstance(data, dict):
        report((), f"a search space must be a mapping from section names to sections, got {echo(data)}")
        return None
    known = ("study", "seed", "plugins", *SECTIONS)
    for key in data:
        if key not in known:
            report((key,), f"unknown section '{key}'; {known_names(key, known)}")
    for key in REQUIRED:
        if key not in data:
            report((), f"section '{key}' is required")
    plugins = _plugins(data.get("plugins"), source, report)
    if plugins is None:
        return None  # whatever names its components would be at fault
    study = _study(data.get("study", "study" if str(source) == _IN_PYTHON else source.stem), report)
    seed = read(data.get("seed", 0), int, Rule(low=0), ("seed",), report)
    sections = _parts(data, report)
    if check_data and "data" in sections:
        for section, message in _data_faults(sections, data["data"], source.parent):
            report((section, *_named_in(message, data[section])), message)
    hardware = names.hardware(data.get("hardware"), report, source.parent)
    written = Written(sections, hardware, source.parent, check_data)
    for path, message in written.faults():
        report(path, message)
    targets = names.targets(data.get("targets"), report)
    limits = names.limits(data["limits"], written.axes, hardware, report) if "limits" in data else None
    split = sections.get("split")
    objectives = (*_OBJECTIVES, *([_ENERGY] if hardware else []))
    if "objectives" in data and all(sections[x].good for x in names.OF_OBJECTIVES if x in sections):
        has_test = "test" in data or split is None or not split.good or split.fixed.has_test
        objectives = names.objectives(
            data["objectives"], hardware, report, has_test=has_test, sections=sections
        )
    if document.faults:
        return None
    return SearchSpace(
        study=study,
        seed=seed,
        plugins=plugins,
        targets=targets,
        limits=limits,
        source=source,
        parts={name: part for name, part in sections.items() if name not in _OF_STUDY},
        axes=written.axes,
        decision=DecisionGrid.of(sections["decision"]),
        hardware=hardware,
        objectives=objectives,
        search=sections["search"].fixed,
        execution=sections["execution"].fixed,
        precision=sections["precision"].fixed if "precision" in sections else None,
        schedule=sections["schedule"].fixed if "schedule" in sections else None,
    )


def _plugins(raw: Raw, source: Path, report: Report) -> tuple[Plugin, ...] | None:
    """Load the plugins of a search space, modules or .py files beside it; None after a fault."""
    names = read(raw or (), tuple[str, ...], Rule(doc=""), ("plugins",), report)
    plugins: list[Plugin] = []
    named_by = None if str(source) == _IN_PYTHON else source  # a mapping is of whoever calls
    good = names is not INVALID
    for index, name in enumerate(names if good else ()):
        try:
            plugin = registry.load_plugin(name, source.parent, named_by=named_by)
        except registry.PluginError as error:
            fault = str(error)
        else:
            fault = ""
            if not plugin.components:
                fault = f"plugin '{name}' must register a component, but it registers none"
            elif plugin.source in (other.source for other in plugins):
                fault = f"plugin '{name}' is named twice"
            plugins.append(plugin)
        if fault:
            report(("plugins", index), fault)
            good = False
    return tuple(plugins) if good else None


def _parts(data: Mapping[str, Raw], report: Report) -> dict[str, Part]:
    """Read the sections that are components or settings."""
    found: dict[str, Part] = {}
    needed = None
    recordings = parts.component(("data",), data["data"], report) if "data" in data else None
    if recordings is not None:
        found["data"], kind, needed = recordings, recordings.kind, front_end(recordings.cls)
        if "test" in data:
            found["test"] = parts.test_file(recordings, data["test"], report)
        if needed != "preprocessing" and "preprocessing" in data:
            report(("preprocessing",), f"section 'preprocessing' does not apply to {kind} recordings")
        if needed == "encoder" and "encoder" not in data:
            report((), f"section 'encoder' is required for {kind} recordings")
    for section in FAMILIES:
        family = parts.family(section, data[section], report) if section in data else None
        if family is not None:
            found[section] = family
    given = {*data, *_WITH_DEFAULTS} - {"preprocessing"}
    if needed == "preprocessing" or (recordings is None and "preprocessing" in data):
        given.add("preprocessing")
    for section, cls in SETTINGS.items():
        if section not in given:
            continue
        raw = data.get(section)
        if section == "decision":
            raw = _grid(raw)
        if section == "search":
            axes = Written(found, (), Path(), False).axes
            raw = search.with_defaults(raw, axes.values(), search.folds(found))
        found[section] = parts.settings(section, cls, raw, report)
    return {name: found[name] for name in SECTIONS if name in found}


def _grid(raw: Raw) -> Raw:
    """Return section `decision` with its defaults; a list is a choice."""
    if not isinstance(raw, dict | None):
        return raw
    keys = {**_DECISION, **(raw or {})}
    return {key: {"choice": value} if isinstance(value, list) else value for key, value in keys.items()}


def _data_faults(sections: Mapping[str, Part], raw: Raw, base: Path) -> list[tuple[str, str]]:
    """Return (section, sentence) for every fault that the headers of the data files show."""
    data, test = sections["data"], sections.get("test")
    values = data.values
    if not data.good:
        assert isinstance(raw, dict)  # it names a component
        # Files can be checked without their numbers: a number at fault must not hide a wrong array name.
        numbers = {
            f.name: 1 for f in dataclasses.fields(data.cls) if f.type == "float" and f.name not in values
        }
        if set(raw) - {"kind"} - values.keys() - numbers.keys() or not numbers:
            return []
        values = values | numbers
    try:
        source: Source = construct(data.cls, values)
        faults = [("data", message) for message in source.check(base)]
        if test is not None and test.good:
            other: Source = construct(data.cls, values | test.values)
            faults += [("test", message) for message in other.check(base)]
    except (TypeError, ValueError):  # a required key is missing, or a rule across keys: reported already
        return []
    return faults


def _named_in(message: str, raw: Raw, above: Keys = ()) -> Keys:
    """Return the keys to the array name that a sentence about a data file quotes; else the file."""
    for key, value in raw.items() if isinstance(raw, dict) else ():
        if isinstance(value, dict) and (inner := _named_in(message, value, (*above, key))) != ("file",):
            return inner
        if isinstance(value, str) and key not in ("kind", "file") and f"'{value}'" in message:
            return (*above, key)
    return ("file",)


def _study(raw: Raw, report: Report) -> str:
    name = read(raw, str, Rule(doc=""), ("study",), report)
    if name is INVALID:
        return ""
    if not names_a_file(str(name)):
        report(("study",), f"study must be valid as a folder name, got {echo(name)}")
    elif len(str(name).encode()) > _LONGEST_NAME:
        text = f"study must have at most {_LONGEST_NAME} bytes, as it names a folder, got"
        report(("study",), f"{text} {len(str(name).encode())}")
    return str(name)
