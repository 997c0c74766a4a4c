"""YAML name -> component. A component is a frozen dataclass; its fields are its YAML keys.

Adding one is adding one file below the package of its section: the decorator gives the YAML name, `param`
gives each key its unit, bounds and meaning, and `dse describe` prints them.

A component may live outside `dse`: in a plugin, which is a module or a .py file that a search space names
(`load_plugin`), or in a module that an installed distribution names in the entry-point group
`dse.components`; an entry point with the name of a section is loaded when that section is asked for. What a
file names runs with the user's consent alone (`dse.base.trust`).
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import importlib
import importlib.metadata
import re
import sys
import traceback
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, Literal, TypeVar

from dse.base import trust
from dse.base.text import one_line

T = TypeVar("T")

SECTIONS = {
    "datasets": "dse.data.recordings",
    "encoders": "dse.data.encoders",
    "figures": "dse.show.figures",
    "hardware.kinds": "dse.measure.hardware.kinds",
    "losses": "dse.engine.losses",
    "models": "dse.models",
    "neurons": "dse.engine.neurons",
    "objectives": "dse.measure.objectives",
    "recordings": "dse.data.recordings",
    "recordings.formats": "dse.data.recordings.formats",
    "reports": "dse.show.report",
    "scene.motions": "dse.scene.motions",
    "search.samplers": "dse.search.samplers",
    "targets": "dse.deploy",
    "views": "dse.show.dashboard",
}
"""Section -> package. A component of a section lives at any depth below its package, in a module that calls
`register("<section>", "<name>")` with the section written out; no other module is imported to find it."""

ENTRY_POINTS = "dse.components"
"""Entry-point group in which an installed distribution names its modules of components."""

ELSEWHERE: Mapping[str, Mapping[str, tuple[str, ...]]] = {
    "dse-papers": {
        "figures": (
            *("distances", "grid", "histograms", "inputs", "intervals", "intervals_by_sample"),
            *("lengths", "preprocessing", "psth", "surface", "sweep"),
        ),
        "models": ("cascade", "hots", "threshold_lif"),
        "reports": ("paper",),
    },
}
"""Distribution of this repository -> section -> components that it holds (`elsewhere`)."""

_MEMBERS: Mapping[str, tuple[str, ...]] = {
    "datasets": ("file", "origin", "licence", "files", "digest", "convert"),
    "encoders": ("n_channels", "positions", "encode_all"),
    "losses": ("lengths", "value", "gradient"),
    "models": ("fit", "respond"),
    "neurons": (
        *("label", "population", "Populations"),
        *("Populations.to_threshold", "Populations.initial_state", "Populations.step"),
    ),
    "objectives": ("needs", "columns", "measure"),
    "reports": ("about", "systems", "rows", "marks", "table"),
}
"""Section -> what a component of it must have, beside what its contract defines for it."""

_PACKAGE = Path(__file__).resolve().parents[1]
_SHIPPED = [x / "icub_roboskin.py" for x in (_PACKAGE / "_search_spaces", _PACKAGE.parent / "search_spaces")]
"""Plugins of shipped search spaces, in an installation and in a clone."""

_ENDING = "a file is named with its ending, {}.py"
_MOST_BYTES = 2**24
"""Size of the largest file that is read as a plugin."""

_components: dict[str, dict[str, type]] = {}
_plugins: dict[str, Plugin] = {}
_left_out: dict[str, str] = {}
_imported: set[str] = set()


class PluginError(ValueError):
    """A plugin cannot be loaded; the message is one sentence."""


@dataclasses.dataclass(frozen=True)
class Plugin:
    """A module of components outside `dse`.

    name: as it was named, in a search space or by an entry point.
    source: a module name, or the absolute path of a file; `load_plugin(source)` loads it in another process.
    components: (section, name) of every component that it registered.
    """

    name: str
    source: str
    components: tuple[tuple[str, str], ...] = ()


@dataclasses.dataclass(frozen=True)
class Rule:
    """What a value must be: bounds, choices, unit and meaning of one key.

    component: section of the component that the key names, '' for a plain value. The component's own keys
        stand beside the key, and the field holds the component that is built from them.
    component_name: the component that is taken where the key is absent.
    """

    doc: str = ""
    unit: str = ""
    low: float | None = None
    high: float | None = None
    low_open: bool = False
    high_open: bool = False
    choices: tuple[Any, ...] = ()
    axis: bool = True
    component: str = ""
    component_name: str = ""


@dataclasses.dataclass(frozen=True)
class Column:
    """A column of a study's tables, which an objective declares.

    name: ends with its unit, such as energy_uj.
    unit: '' for a plain number.
    direction: the better one.
    doc: one line of meaning.
    of_design: all points of a trial have the number of its full read-out; otherwise each has its own, or none
        where it was not measured.
    selects: whether a search and a front may use it; not what labels of the test set say.
    of_test: whether it is measured on the test set; a study without one lacks it.
    of_section: section, or section.key, without which a study lacks it; '' for none.
    known: whether it is known of a design before it is trained ('exact'), or has a lower bound ('bound').
    ranged: whether tables also have its least and largest value over the repeats, <name>_min and <name>_max.
    """

    name: str
    unit: str
    direction: Literal["max", "min"]
    doc: str
    of_design: bool = False
    selects: bool = True
    of_test: bool = False
    of_section: str = ""
    ranged: bool = False
    known: Literal["", "exact", "bound"] = ""


def param(default: Any = dataclasses.MISSING, **rule: Any) -> Any:
    """Declare a dataclass field with its `Rule` (keywords of Rule); without a default it is required.

    `param("cuba_lif", component="neurons", doc=...)` declares a field that holds a component of section
    `neurons`. In YAML its key names the component, whose own keys stand beside it in the same mapping; in
    Python the default is the component with its own defaults.
    """
    section = rule.get("component")
    if section and default is not dataclasses.MISSING:
        return dataclasses.field(
            default_factory=functools.partial(_default_component, section, default),
            metadata={"rule": Rule(**{"component_name": default} | rule)},
        )
    return dataclasses.field(default=default, metadata={"rule": Rule(**rule)})


def fixed(default: Any = dataclasses.MISSING, *, factory: Any = dataclasses.MISSING, **rule: Any) -> Any:
    """Declare a dataclass field as `param` does, which no search varies; `factory` makes its default."""
    if factory is dataclasses.MISSING:
        return param(default, axis=False, **rule)
    return dataclasses.field(default_factory=factory, metadata={"rule": Rule(axis=False, **rule)})


def _default_component(section: str, name: str) -> object:
    return known(section)[name]()


def rule_of(field: dataclasses.Field[Any]) -> Rule:
    """Return the rule of a component's field."""
    rule = field.metadata.get("rule")
    return rule if isinstance(rule, Rule) else Rule(doc="")


def register(section: str, name: str) -> Callable[[type[T]], type[T]]:
    """Register a frozen dataclass under a section and a name.

    Raises:
        ValueError: no such section, or the name is taken.
        TypeError: the class is no frozen dataclass, or lacks a member that components of the section have.
    """

    def decorate(cls: type[T]) -> type[T]:
        if section not in SECTIONS:
            raise ValueError(f"unknown section '{section}' of {cls.__name__}; known: {', '.join(SECTIONS)}")
        if not dataclasses.is_dataclass(cls) or not cls.__dataclass_params__.frozen:  # type: ignore[attr-defined]
            raise TypeError(f"{cls.__name__} must be a frozen dataclass")
        if not _is_shipped(cls):
            _import_section(section)  # so that a shipped name is never free
        components = _components.setdefault(section, {})
        holder = components.get(name, cls)
        if (holder.__module__, holder.__qualname__) != (cls.__module__, cls.__qualname__):
            plugin = plugin_of(holder)
            by = f"plugin '{plugin.name}'" if plugin else holder.__module__
            raise ValueError(f"{section} '{name}' is already registered by {by}")
        if lacks := [member for member in _MEMBERS.get(section, ()) if not _has(cls, member)]:
            raise TypeError(f"{section} '{name}' must have {', '.join(lacks)}")
        if section == "objectives":
            _check_columns(cls, name, components)
        components[name] = cls
        return cls

    return decorate


def known(section: str) -> dict[str, type]:
    """Return the components of a section by name: those of `dse`, of installed distributions and of plugins.

    Raises:
        ValueError: no such section.
    """
    if section not in SECTIONS:
        raise ValueError(f"unknown section '{section}'; known: {', '.join(SECTIONS)}")
    _import_section(section)
    _load_entry_points("")
    _load_entry_points(section)
    return dict(sorted(_components.get(section, {}).items()))


def elsewhere(section: str, name: str) -> str:
    """Return the end of a sentence about an unknown component: the plugin of this repository that holds it.

    '' where none does, or where that plugin is installed.
    """
    for distribution, sections in ELSEWHERE.items():
        if name in sections.get(section, ()) and name not in known(section):
            return f" of plugin {distribution}: pip install ./plugins/{distribution} in the clone"
    return ""


def _has(cls: type, member: str) -> bool:
    """Return whether a class defines a member, or has a field of this name; `a.b`: member b of its class a.

    What a protocol above it declares does not count.
    """
    first, _, rest = member.partition(".")
    holders = [owner for owner in cls.__mro__ if first in vars(owner)]
    if rest:
        return not holders or _has(getattr(cls, first), rest)
    is_field = dataclasses.is_dataclass(cls) and any(x.name == first for x in dataclasses.fields(cls))
    return is_field or bool(holders and not getattr(holders[0], "_is_protocol", False))


def _check_columns(objective: Any, name: str, others: Mapping[str, Any]) -> None:
    """Refuse an objective with a column of another one."""
    taken = {c.name: other for other, cls in others.items() if other != name for c in cls.columns}
    for column in objective.columns:
        if column.name in taken:
            other = taken[column.name]
            raise ValueError(f"column '{column.name}' is already declared by objective '{other}'")


def columns(needs: str | None = None) -> dict[str, Column]:
    """Return the columns that the registered objectives declare, by name.

    Args:
        needs: what their objectives need (`dse.measure.objectives.Objective`); None: anything.
    """
    objectives: Iterable[Any] = known("objectives").values()
    declared = [c for cls in objectives if needs in (None, cls.needs) for c in cls.columns]
    return {column.name: column for column in sorted(declared, key=lambda column: column.name)}


def name_of(section: str, component: object) -> str:
    """Return the name under which the class of a component is registered.

    Raises:
        ValueError: it is not registered in the section.
    """
    for name, cls in known(section).items():
        if type(component) is cls:
            return name
    raise ValueError(f"{type(component).__name__} is not registered in section '{section}'")


def load_plugin(
    name: str, base: Path | None = None, *, named_by: str | Path | None = None, asks: bool = True
) -> Plugin:
    """Import a module of components; a plugin that is loaded already is not imported again.

    No other function runs code that is not part of an installation.

    The module of a file is named by its contents: objects of its classes can be pickled and unpickled by
    every process that has loaded the same contents, and a file that has changed is loaded anew, in place of
    what it registered before.

    Args:
        name: the name of an installed module, or a path that ends in .py.
        base: folder that a path is relative to; absent: the current one.
        named_by: the file that names it: it runs with the user's consent alone (`dse.base.trust`). None: who
            calls names it, and consents by that.
        asks: whether the user may be asked.

    Raises:
        PluginError: there is no such module or file, the user does not consent, it fails while it is
            imported, or the name of one of its components is taken. Then nothing of it is registered.
    """
    if not name.endswith(".py"):
        if not all(part.isidentifier() for part in name.split(".")):
            raise PluginError(f"plugin '{name}' must be the name of a module or a path that ends in .py")
        _load_entry_points("")
        is_here = name in _plugins or name in sys.modules
        if named_by is not None and not is_here and all(x.module != name for x in _entry_points()):
            place, code = _module(name)
            digest = hashlib.sha256(f"{name}\0{place}\0".encode() + code).hexdigest()
            _ask(name, f"module {name} of {place}", digest, named_by, asks)
        return _load(Plugin(name, name), name, lambda: importlib.import_module(name))
    path = ((base or Path()) / Path(name).expanduser()).resolve()
    code = _code(name, path)
    stem, digest = re.sub(r"\W", "_", path.stem), hashlib.sha256(code).hexdigest()
    module = f"dse_plugin_{stem}_{digest[:16]}"
    if not (named_by is None or module in _plugins or path in _SHIPPED):
        _ask(name, str(path), digest, named_by, asks)
    return _load(Plugin(name, str(path)), module, lambda: _run_file(path, code, module))


def load_trusted(names: Iterable[object], named_by: Path) -> None:
    """Load the plugins of a folder that is read; nobody is asked.

    What may not run, or cannot, is left out (`left_out`): names of its components are texts like any other.
    """
    for name in map(str, names):
        try:
            load_plugin(name, named_by=named_by, asks=False)
        except PluginError as error:
            _left_out[name] = str(error)


def left_out() -> list[str]:
    """Return why plugins of folders that were read since the last call are not loaded, a sentence each."""
    sentences = list(_left_out.values())
    _left_out.clear()
    return sentences


def plugin_of(cls: type) -> Plugin | None:
    """Return the plugin that a class is from; None: `dse`, or a module that was imported otherwise."""
    return next((x for module, x in _plugins.items() if f"{cls.__module__}.".startswith(f"{module}.")), None)


def loaded_plugins() -> dict[str, str]:
    """Return module -> source of the loaded plugins, in the order of loading, for `load_the_same`."""
    return {module: plugin.source for module, plugin in _plugins.items()}


def named_plugins() -> list[str]:
    """Return the modules of the loaded plugins without those that installed distributions name for a section.

    The latter are loaded or not as sections were asked for, and say nothing of a study.
    """
    lazy = {entry.module for entry in _entry_points() if entry.name in SECTIONS}
    return sorted(_plugins.keys() - lazy)


def interactive() -> list[tuple[str, str, type]]:
    """Return section, name and class of the components that a notebook or a script defines itself."""
    return [(*pair, cls) for pair, cls in _outside().items() if cls.__module__ == "__main__"]


def load_the_same(plugins: Mapping[str, str]) -> None:
    """Load the plugins that another process has loaded, so that objects of their classes can be unpickled.

    Args:
        plugins: of `loaded_plugins`.

    Raises:
        PluginError: as of `load_plugin`, or a file has changed since.
    """
    for module, source in plugins.items():
        if module not in _plugins:
            load_plugin(source)
            if module not in _plugins:
                raise PluginError(f"plugin '{source}' has changed since it was loaded; start again")


def _load(plugin: Plugin, module: str, import_module: Callable[[], object]) -> Plugin:
    """Import a plugin's module, or leave the registry as it was."""
    if module in _plugins:
        return dataclasses.replace(plugin, components=_plugins[module].components)
    before = _outside()
    older = [name for name, loaded in _plugins.items() if loaded.source == plugin.source]
    _replace({pair: cls for pair, cls in before.items() if cls.__module__ not in older})
    try:
        import_module()
    except BaseException as error:
        for cls in set(_outside().values()) - set(before.values()):
            sys.modules.pop(cls.__module__, None)  # so that the next import registers again
        _replace(before)
        if isinstance(error, Exception | SystemExit):
            raise PluginError(f"plugin '{plugin.name}': {failure(error, plugin)}") from error
        raise
    for name in older:
        del _plugins[name]
    components = sorted(
        pair
        for pair, cls in _outside().items()
        if before.get(pair) is not cls or f"{cls.__module__}.".startswith(f"{module}.")
    )
    _plugins[module] = dataclasses.replace(plugin, components=tuple(components))
    return _plugins[module]


def _ask(name: str, what: str, digest: str, named_by: str | Path, asks: bool) -> None:
    """Raise a PluginError unless the user consents to code."""
    what, by = one_line(what), one_line(str(named_by))
    if not trust.consents(f"{what}, which {by} names", digest, asks=asks):
        how = "then say --trust once, or in Python call dse.base.registry.load_plugin"
        text = f"is code that you have not trusted: look at {what} (SHA-256 {digest}), {how}"
        raise PluginError(f"plugin '{name}' {text}")


def _module(name: str) -> tuple[str, bytes]:
    """Return where a module lies and its source; nothing is imported, packages above it neither."""
    spec, where, parts = None, None, name.split(".")
    for n in range(1, len(parts) + 1):
        full = ".".join(parts[:n])
        found = (finder.find_spec(full, where) for finder in sys.meta_path if hasattr(finder, "find_spec"))
        spec = next((one for one in found if one is not None), None)
        if spec is None:
            raise PluginError(f"plugin '{name}': no module '{full}' is installed; {_ENDING.format(name)}")
        where = list(spec.submodule_search_locations or ())
    place = (spec and spec.origin) or ""
    return place, _code(name, Path(place)) if Path(place).is_file() else b""


def _code(name: str, path: Path) -> bytes:
    """Return the source of a plugin."""
    try:
        if path.exists() and not path.is_file():
            raise PluginError(f"plugin '{name}': {path} must be a file of Python source")
        with path.open("rb") as file:
            code = file.read(_MOST_BYTES + 1)
    except OSError as error:
        raise PluginError(f"plugin '{name}': cannot read {path}: {error.strerror}") from None
    if len(code) > _MOST_BYTES:
        raise PluginError(f"plugin '{name}': {path} must have at most {_MOST_BYTES} bytes")
    return code


def _run_file(path: Path, code: bytes, name: str) -> None:
    """Run a file as a module of a name; unlike an import it leaves no compiled file beside it."""
    module = ModuleType(name)
    module.__file__ = str(path)
    sys.modules[name] = module
    try:
        exec(compile(code, str(path), "exec"), module.__dict__)
    except BaseException:
        del sys.modules[name]
        raise


def failure(error: BaseException, plugin: Plugin) -> str:
    """Return the error of a plugin's code as one sentence, with the line."""
    if isinstance(error, ModuleNotFoundError) and f"{plugin.source}.".startswith(f"{error.name}."):
        return f"no module '{error.name}' is installed; {_ENDING.format(plugin.name)}"
    kind = type(error).__name__
    if isinstance(error, SyntaxError):
        return f"{kind} in line {error.lineno} of {error.filename}: {error.msg}"
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if frame.filename != __file__ and not frame.filename.startswith("<frozen")
    ]
    of_file = [frame for frame in frames if frame.filename == plugin.source]
    frame = (of_file or frames)[-1]
    return f"{kind} in line {frame.lineno} of {frame.filename}: {error}"


def _import_section(section: str) -> None:
    """Import the modules below a section's package that register a component of it."""
    if section in _imported:
        return
    package = importlib.import_module(SECTIONS[section])
    registers = re.compile(rf'\bregister\(\s*"{re.escape(section)}"')
    for folder in package.__path__:
        for path in sorted(Path(folder).rglob("*.py")):
            if registers.search(path.read_text(encoding="utf-8")):
                parts = path.relative_to(folder).with_suffix("").parts
                importlib.import_module(".".join((package.__name__, *parts)).removesuffix(".__init__"))
    _imported.add(section)


@functools.cache
def _entry_points() -> Sequence[importlib.metadata.EntryPoint]:
    return tuple(importlib.metadata.entry_points(group=ENTRY_POINTS))


def _load_entry_points(section: str) -> None:
    """Load the modules that installed distributions name for a section; '': for no section in particular.

    What fails is left out, with a warning.
    """
    if (done := f"{ENTRY_POINTS} {section}") in _imported:
        return
    _imported.add(done)
    for entry in _entry_points():
        if section != (entry.name if entry.name in SECTIONS else ""):
            continue
        try:
            load_plugin(entry.module)
        except PluginError as error:
            distribution = entry.dist.name if entry.dist else "unknown"
            warnings.warn(f"distribution {distribution}, entry point {entry.name}: {error}", stacklevel=3)


def _is_shipped(cls: type) -> bool:
    return cls.__module__.startswith("dse.")


def _outside() -> dict[tuple[str, str], type]:
    """Return the components outside `dse`: (section, name) -> class."""
    return {
        (section, name): cls
        for section, components in _components.items()
        for name, cls in components.items()
        if not _is_shipped(cls)
    }


def _replace(outside: dict[tuple[str, str], type]) -> None:
    """Make these the components outside `dse`."""
    for section, name in _outside().keys() - outside.keys():
        del _components[section][name]
    for (section, name), cls in outside.items():
        _components.setdefault(section, {})[name] = cls
