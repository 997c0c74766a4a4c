"""Views of a page by name: the files of `dashboards/views/`, and the views of plugins.

A view is a script (`dashboards/views.js` says what it must do). Files of the same name beside it are its
style (.css) and its section of the page (.html); without the latter it has an empty one. A plugin's view is a
frozen dataclass registered in section `views` with `script: ClassVar[str | Path]`, the script or its file.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Protocol

from dse.base import registry
from dse.config.locate import shipped_folder

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


class View(Protocol):
    """A view of a plugin."""

    script: ClassVar[str | Path]


class ViewError(ValueError):
    """A view of a plugin cannot be part of a page; the message is one sentence."""


@dataclass(frozen=True)
class ViewSource:
    """The parts of a page that a view adds."""

    name: str
    script: str
    section: str
    style: str


def view_names() -> list[str]:
    """Return the names of all views, those of the package first."""
    shipped = [path.stem for path in _shipped()]
    return [*shipped, *(name for name in registry.known("views") if name not in shipped)]


def view_sources(names: list[str]) -> list[ViewSource]:
    """Return the sources of every view of the package and of the named views of plugins, in that order."""
    known = registry.known("views")
    views = [_of_file(path.stem, path) for path in _shipped()]
    views += [source_of(name, getattr(known[name], "script", None)) for name in names if name in known]
    return sorted(views, key=lambda view: names.index(view.name) if view.name in names else len(names))


def _shipped() -> list[Path]:
    return sorted((shipped_folder("dashboards") / "views").glob("*.js"))


def source_of(name: str, script: object) -> ViewSource:
    """Return the source of a view, given its script or the path of that.

    Raises:
        ViewError: no page can hold it.
        OSError: a file cannot be read.
    """
    if not _NAME.fullmatch(name):
        raise ViewError(f"view '{name}': a name must be letters, digits and '_', a letter first")
    if isinstance(script, Path):
        source = _of_file(name, script)
    elif isinstance(script, str):
        source = ViewSource(name, script, _empty(name), "")
    else:
        raise ViewError(f"view '{name}': its `script` must be a script or the path of its file")
    # The end of its element would end the script there, and what follows would be text of the page.
    if "</script" in source.script.lower():
        raise ViewError(f"view '{name}': its script must not contain '</script'")
    return source


def _of_file(name: str, path: Path) -> ViewSource:
    section, style = path.with_suffix(".html"), path.with_suffix(".css")
    return ViewSource(
        name,
        path.read_text(encoding="utf-8"),
        section.read_text(encoding="utf-8") if section.is_file() else _empty(name),
        style.read_text(encoding="utf-8") if style.is_file() else "",
    )


def _empty(name: str) -> str:
    return f'<section id="view-{name}" data-view="{name}" aria-label="{name}"></section>\n'
