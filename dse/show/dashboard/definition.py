"""The parts and the initial settings of a page, as YAML: a file of `dashboards/`, or a file of the user.

Studies have different columns: a column that a study lacks is no fault of the file, and the page says so.
"""

from __future__ import annotations

import typing
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from dse.base.registry import PluginError, fixed, load_plugin
from dse.config.faults import known_names
from dse.config.locate import find_file, shipped_folder, yaml_files
from dse.config.values import Report, dotted, echo, read_fields
from dse.config.yaml_lines import Document, read_document
from dse.config.yaml_lines import Path as Keys
from dse.show.dashboard.views import view_names

Tab = Literal[
    "confusion",
    "surface",
    "raster",
    "recognition",
    "first_spike",
    "histograms",
    "energy",
    "power",
    "cores",
    "learning",
    "bits",
]
DEFAULT = "study"
_AXES = ("x", "y")


@dataclass(frozen=True)
class FrontView:
    """The figure of the front. The page chooses whatever is None from the objectives."""

    x: str | None = fixed(None, doc="column of the horizontal axis")
    y: str | None = fixed(None, doc="column of the vertical axis")
    log: tuple[str, ...] = fixed(
        (), doc="columns with a logarithmic axis, in addition to those that span more than two decades"
    )


@dataclass(frozen=True)
class Definition:
    """The keys of a page definition. The page chooses whatever is None."""

    title: str = fixed("", doc="title, shown beside the name of the study")
    plugins: tuple[str, ...] = fixed(
        (), doc="plugins with additional views: modules, or .py files relative to this file"
    )
    views: tuple[str, ...] | None = fixed(
        None, doc="parts of the page, in order (default: those of the page 'study')"
    )
    front: FrontView = fixed(
        factory=FrontView, doc="settings of the figure of the front (`dse describe page.front`)"
    )
    parallel: tuple[str, ...] | None = fixed(
        None,
        doc="columns of the parallel coordinates, in order (default: objectives, budgets and the axes that "
        "vary)",
    )
    table: tuple[str, ...] | None = fixed(
        None, doc="columns of the table after trial and task (default: objectives and the axes that vary)"
    )
    design: tuple[Tab, ...] = fixed(typing.get_args(Tab), doc="tabs of the panel of a design, in order")
    budgets: Mapping[str, float] = fixed(factory=dict, doc="initial budgets: mapping from column to limit")
    sort: str | None = fixed(None, doc="column by which the table is sorted (default: the first objective)")


def shipped_definitions() -> dict[str, Path]:
    """Return the page definitions that come with the package (in a clone: `dashboards/`), by name."""
    return yaml_files(shipped_folder("dashboards"))


def load(name: str | Path = DEFAULT) -> Definition:
    """Read a page definition: one of the package by its name, or a file.

    The plugins of the definition are loaded before its views are looked up.

    Raises:
        ConfigError: no such definition, or everything that is wrong with the file.
    """
    shipped = shipped_definitions()
    path = shipped.get(str(name)) or find_file(str(name), shipped, "page")
    document = read_document(path, {})
    document.check()
    values = _values(document, path)
    document.check()
    return Definition(**values)


def _values(document: Document, file: Path) -> dict[str, Any]:
    """Return the valid keys of the file, each in its type."""
    report = document.report
    values, _ = read_fields(Definition, document.data, (), report, has_defaults=False)
    for place, plugin in enumerate(values.get("plugins", ())):
        try:
            load_plugin(plugin, file.parent, named_by=file)
        except PluginError as error:
            report(("plugins", place), str(error))
    _check_views(values.get("views"), report)
    _no_twins(document.data if isinstance(document.data, dict) else {}, report)
    return values


def _check_views(views: Sequence[str] | None, report: Report) -> None:
    if views == ():
        report(("views",), "views must contain at least one part of the page, got []")
    known = view_names() if views else []
    for place, name in enumerate(views or ()):
        if name not in known:
            report(("views", place), f"unknown views[{place}] '{name}'; {known_names(name, known)}")


def _no_twins(data: Mapping[str, Any], report: Report) -> None:
    """Report names that a list holds twice, and a column on two axes."""
    front = data["front"] if isinstance(data.get("front"), dict) else {}
    lists: dict[Keys, Any] = {
        (key,): data.get(key) for key in ("plugins", "views", "parallel", "table", "design")
    }
    lists["front", "log"] = front.get("log")
    for path, names in lists.items():
        for place, name in enumerate(names if isinstance(names, list) else ()):
            if name in names[:place]:
                report(
                    (*path, place), f"{dotted(path)} must not contain a name twice, got {echo(name)} again"
                )
    axes = [axis for axis in _AXES if front.get(axis) is not None]
    for place, axis in enumerate(axes):
        same = [other for other in axes[:place] if front[other] == front[axis]]
        if same:
            must = f"front.{axis} must be another column than front.{same[0]}"
            report(("front", axis), f"{must}, got {echo(front[axis])} twice")


def definition_for(
    definition: Definition, columns: Mapping[str, Mapping[str, Any]], budgets: Collection[str]
) -> tuple[dict[str, Any], list[str]]:
    """Return the parts of a definition that a study's page can show, and sentences about the rest.

    columns: of the page with their `values`; empty before the first trial: then no sentences.
    budgets: columns that have a budget.

    Returns:
        title: text, '' without one;
        views, design: names of parts and of tabs, in order;
        front: {x, y: column or None, log: columns};
        parallel, table: columns in order, or None; sort: column or None;
        budgets: {column: number}.
        The page chooses whatever is None; an axis is None if its column has no numbers.
    """
    front = definition.front
    axes = {axis: getattr(front, axis) for axis in _AXES}
    numeric = {name for name, column in columns.items() if any(map(_is_number, column["values"]))}

    def present(names: Sequence[str] | None) -> list[str] | None:
        return [name for name in names or () if name in columns] or None

    page = {
        "title": definition.title,
        "views": list(definition.views or load().views or ()),
        "front": {
            **{axis: name if name in numeric else None for axis, name in axes.items()},
            "log": [name for name in front.log if name in columns],
        },
        "parallel": present(definition.parallel),
        "table": present(definition.table),
        "design": list(definition.design),
        "budgets": {name: limit for name, limit in definition.budgets.items() if name in budgets},
        "sort": definition.sort if definition.sort in columns else None,
    }
    drawn = [name for name in axes.values() if name is not None]
    named = [*drawn, *(definition.parallel or ()), *(definition.table or ()), *definition.budgets]
    named += [] if definition.sort is None else [definition.sort]
    faults = {
        "has no": [name for name in named if name not in columns],
        "has no numbers to draw in": [name for name in drawn if name in columns and name not in numeric],
        "has no budget of": [name for name in definition.budgets if name in columns and name not in budgets],
    }
    notes = [
        f"This study {fault} {', '.join(dict.fromkeys(names))}, used in the page definition."
        for fault, names in faults.items()
        if names and columns
    ]
    return page, notes


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
