"""Readers of the sections that are lists: hardware, targets, objectives and limits."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path

from dse.base import registry
from dse.base.registry import Rule
from dse.config.axes import Axis
from dse.config.expressions import ExpressionError, column_names, condition_fault, parse
from dse.config.faults import known_names
from dse.config.locate import is_hardware_file, shipped_profiles
from dse.config.parts import Part
from dse.config.values import INVALID, Report, read
from dse.config.yaml_lines import Raw

OF_OBJECTIVES = ("evaluation", "schedule")
"""Sections that columns need (`Column.of_section`)."""


def hardware(raw: Raw, report: Report, base: Path) -> tuple[str, ...]:
    """Read the names of hardware profiles, or their files; their content is checked where they are loaded."""
    texts = _texts("hardware", raw, report)
    for index, name in enumerate(texts):
        if is_hardware_file(name) and not (base / name).is_file():
            text = "must be a file, relative to the search space; there is none"
            report(("hardware", index), f"hardware '{name}' {text}")
    files = filter(is_hardware_file, texts)
    return _each_once("hardware", texts, [*shipped_profiles(), *files], report)


def targets(raw: Raw, report: Report) -> tuple[str, ...]:
    """Read the names of targets that designs are to be exported to."""
    return _each_once("targets", _texts("targets", raw, report), registry.known("targets"), report)


def objectives(
    raw: Raw,
    profiles: Sequence[str],
    report: Report,
    *,
    has_test: bool,
    sections: Mapping[str, Part],
) -> tuple[tuple[str, str], ...]:
    """Read objectives written `name:max`, `name:min` or `name` alone for the direction it declares."""
    known = registry.columns()
    of_hardware = registry.columns("hardware")
    if raw == [] or raw is None:
        report(("objectives",), f"objectives must hold at least one objective; {known_names('', known)}")
    texts = _texts("objectives", raw, report)
    pairs = [tuple(x.strip() for x in text.partition(":")) for text in texts]
    names = _each_once("objectives", [name for name, *_ in pairs], known, report)
    for index, (name, colon, direction) in enumerate(pairs):
        if name not in known:
            continue
        column, faults = known[name], []
        if colon and direction not in ("max", "min"):
            faults.append(f"must be followed by :max or :min, got '{texts[index]}'")
        elif colon and direction != column.direction:
            faults.append(f"must be '{name}:{column.direction}', got '{texts[index]}'")
        if name in of_hardware and not profiles:
            faults.append("needs a hardware profile in section 'hardware', got none")
        if column.of_test and not has_test:
            faults.append("needs a test set: section 'test', or key test of the split")
        section, _, key = column.of_section.partition(".")
        if section and (section not in sections or (key and sections[section].values.get(key) is None)):
            faults.append(f"needs {key + ' in ' if key else ''}section '{section}', got none")
        if not column.selects:
            faults.append("cannot select designs: the test set is only for reporting")
        for text in faults:
            report(("objectives", index), f"objective '{name}' {text}")
    return tuple((name, known[name].direction) for name in names if name in known)


def limits(raw: Raw, axes: Mapping[str, Axis], profiles: Sequence[str], report: Report) -> tuple[str, ...]:
    """Read conditions on what is known of a design before it is trained."""
    texts = _texts("limits", raw, report)
    for index, text in enumerate(texts):
        for message in _limit_faults(text, axes, profiles):
            report(("limits", index), f"limit '{text}'{message}")
    return _each_once("limits", texts, texts, report)


def _limit_faults(text: str, axes: Mapping[str, Axis], profiles: Sequence[str]) -> Iterator[str]:
    """Yield what is wrong with a limit, each the end of a sentence about it."""
    try:
        tree = parse(text)
    except ExpressionError as error:
        yield f": {error}"
        return
    columns, of_hardware = registry.columns(), registry.columns("hardware")
    known = {name: column.known for name, column in columns.items() if column.known}
    is_text = {name: axis.is_text for name, axis in axes.items()}
    is_text |= dict.fromkeys(("task", "family", "encoder"), True)
    names, good = dict.fromkeys(column_names(tree)), True
    for name in names:
        fault = ""
        if name in columns and name not in known:
            fault = f"is known only after training; {known_names('', known)}"
        elif name in of_hardware and not profiles:
            fault = "needs a hardware profile in section 'hardware', got none"
        elif name in known or name in is_text:
            continue
        else:
            fault = f"is unknown; {known_names(name, [*known, *is_text])}"
        if fault:
            good = False
            yield f": column '{name}' {fault}"
    if not names:
        yield " must name a column, an axis, task, family or encoder"
    elif good and (fault := condition_fault(text, is_text, {"fits"})):
        yield fault


def _texts(section: str, raw: Raw, report: Report) -> list[str]:
    """Return a list of texts, of which one alone stands for a list of one."""
    texts = read(raw or (), tuple[str, ...], Rule(), (section,), report)
    return [] if texts is INVALID else list(texts)


def _each_once(section: str, names: Sequence[str], known: Collection[str], report: Report) -> tuple[str, ...]:
    """Return names, each once; report those that are unknown or stand there twice."""
    what = section if section == "hardware" else section.removesuffix("s")
    for index, name in enumerate(names):
        if name not in known:
            report((section, index), f"unknown {what} '{name}'; {known_names(name, known)}")
        elif name in names[:index]:
            report((section, index), f"{what} '{name}' is named twice")
    return tuple(dict.fromkeys(names))
