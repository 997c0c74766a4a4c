"""The reference of search spaces, pages and scenes, as rows that are read from the code."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from dse.base import registry
from dse.base.registry import rule_of
from dse.cli import glossary
from dse.config.bounds import BOUNDS
from dse.config.locate import is_hardware_file, shipped_profiles
from dse.config.parts import COMPONENTS, WITH_AXES
from dse.config.resolved import SECTIONS, SETTINGS
from dse.config.values import Key, bounds, echo, expected, keys_of

if TYPE_CHECKING:
    from dse.scene.presets import Preset

Row = Mapping[str, object]
Texts = dict[str, str]
_AFTER = {
    "search.samplers": "Algorithms that propose designs; search.sampler selects one.",
    "recordings.formats": "Formats of event files; data.format selects one (default: recognised from the "
    "file).",
    "neurons": "Neurons of spiking models; model.neuron selects one, whose keys stand beside it.",
    "losses": "Losses of spiking models; model.loss selects one, whose keys stand beside it.",
    "figures": "Figures of a study: `dse figure RESULTS NAME --out FILE`.",
    "page": "Page definition of `dse dashboard --page FILE`: parts of the page and initial settings.",
    "page.front": "The figure of the front on the page.",
    "scene": "Scene file: simulated touch, used by data of kind scene.",
    "scene.sensor": "Shipped sensors: the numbers of sensor and camera, each with its evidence.",
    "scene.textures": "Shipped textures: numbers, each with its evidence.",
    "scene.motions": "Velocity profiles; `kind` names a component.",
    "scene.camera": "The event camera that watches the pins.",
    "scene.variation": "how trials with the same texture, motion and force differ; standard deviations "
    "unless stated",
    "scene.method": "Steps of the simulation: a trade-off of speed and error.",
    "boards": "What `dse export --board` writes a target for, with a project and the commands that flash it.",
    "bounds": "How much work and memory a file may ask for.",
    "columns": "The columns of a study's tables.",
}
"""What is described after the sections of a search space."""
_DOCS = {
    "data": "The recordings; `kind` names a component.",
    "test": "A separate test file or folder: the keys of data that differ for it.",
    "encoder": "turns recordings into input spikes; required for sampled signals; `kind` names a "
    "component, `choice` lists several as an axis",
    "model": "The classifier; `kind` names a component, `choice` lists several as an axis.",
    "targets": "Forms of an exported classifier; `dse pick` has their memory, exact, and predicted cycles "
    "(columns ram_bytes, table_bytes, flash_bytes, cycles), and --export writes them.",
    "hardware": "Hardware profiles for energy and latency: shipped ones by name, or YAML files of your own.",
    "objectives": "Columns to minimise or maximise, each as NAME:min or NAME:max.",
    "limits": "Conditions that each design must be able to meet, such as n_weights <= 20000 or fits; one "
    "that cannot, by what is known before training, is not trained. Of several hardware profiles, one has to "
    "do. Axes, task, family and encoder may be named, and these columns:",
}
_COMPONENTS = (*COMPONENTS.values(), "search.samplers", "figures", "neurons", "losses", "scene.motions")
_WITH_AXES = (*WITH_AXES, "neurons", "losses", "decision", "scene", "scene.motions")
LISTED = ("targets", "boards", "objectives", "limits", "recordings.formats", "columns")
"""Sections whose names have no keys of their own."""


def sections() -> list[Texts]:
    """Return name and meaning of the sections of a search space, then of a page, a scene and of tables."""
    docs = {name: _DOCS.get(name) or _doc(SETTINGS[name]) for name in SECTIONS} | _AFTER
    return [{"section": name, "doc": doc} for name, doc in docs.items()]


def names(section: str) -> list[Texts]:
    """Return the components of a section, or the names that a list may hold; empty if it has neither."""
    if section == "columns":
        return glossary.columns()
    if section == "objectives":
        return [
            {"name": name, "direction": x.direction, "unit": x.unit, "doc": f"{x.direction}: {x.doc}"}
            for name, x in registry.columns().items()
        ]
    if section == "limits":
        before = {"exact": "known before training", "bound": "lower bound before training"}
        return [
            {"name": name, "unit": x.unit, "doc": f"{before[x.known]}: {x.doc}"}
            for name, x in registry.columns().items()
            if x.known
        ]
    if section == "hardware":
        from dse.measure.hardware.profile import load

        return [{"name": name, "doc": load(name).doc} for name in shipped_profiles()]
    if section == "boards":
        from dse.deploy.boards import BOARDS

        return [{"name": x.name, "doc": f"{x.title}: target {x.target}"} for x in BOARDS.values()]
    known: Mapping[str, Any] = registry.known(package) if (package := _package(section)) else {}
    if section == "targets":
        return [{"name": name, "extra": x.extra, "doc": f"{x.label}: {_doc(x)}"} for name, x in known.items()]
    if section == "recordings.formats":
        return [{"name": name, "suffixes": " ".join(x.suffixes), "doc": _doc(x)} for name, x in known.items()]
    if presets := _presets(section):
        return [{"name": name, "doc": preset.doc} for name, preset in presets.items()]
    return [{"name": name, "doc": _doc(cls)} for name, cls in known.items()]


def keys(section: str, name: str | None) -> list[Row]:
    """Return the keys of a section or of a component: type, bounds, unit, default, meaning."""
    if section == "bounds":
        return [{"name": bound, "most": most, "of": of} for bound, (most, of) in BOUNDS.items()]
    if section == "hardware":
        return _figures(str(name))
    if section in LISTED:
        return [row for row in names(section) if row["name"] == name]
    if presets := _presets(section):
        return _evidence(section, presets[str(name)])
    package = _package(section)
    cls = registry.known(package)[str(name)] if package else _class(section)
    return [_row(key_name, key, section in _WITH_AXES) for key_name, key in keys_of(cls).items()]


def is_file(section: str, name: str | None) -> bool:
    """Return whether a component is described from a file of the user's own."""
    return section == "hardware" and is_hardware_file(name or "")


def _package(section: str) -> str | None:
    """Return the section of the registry that holds the components of a section; None: it has none."""
    package = COMPONENTS.get("data" if section == "test" else section, section)
    return package if package in (*_COMPONENTS, "targets", "recordings.formats") else None


def _class(section: str) -> type:
    if section.startswith("page"):
        from dse.show.dashboard.definition import Definition, FrontView

        return Definition if section == "page" else FrontView
    if section in SETTINGS:
        return SETTINGS[section]
    from dse.scene.load import SceneFile
    from dse.scene.scene import Camera, Method, Variation

    of_scene = {"scene.camera": Camera, "scene.variation": Variation, "scene.method": Method}
    return of_scene.get(section, SceneFile)


def _presets(section: str) -> Mapping[str, Preset]:
    from dse.scene import presets

    return {"scene.sensor": presets.sensors, "scene.textures": presets.textures}.get(section, dict)()


def remarks(section: str, name: str | None) -> list[str]:
    """Return sentences about a component in addition to its keys: of a hardware profile, and of a target."""
    if section == "targets" and name is not None:
        target: Any = registry.known(section)[name]
        extra = [f"needs pip install 'dse-spiking[{target.extra}]'"] if target.extra else []
        chip = getattr(target, "profile", "")
        beside = "or the profile in --hardware whose key target is this one"
        predicted = [f"cycles of `dse pick`: per inference, predicted by {chip}, {beside}"] if chip else []
        return [*extra, *predicted, f"use: {target.use}"]
    if section != "hardware" or name is None:
        return []
    from dse.measure.hardware.profile import kinds, load

    profile = load(name)
    kind, cls = next((kind, cls) for kind, cls in kinds().items() if type(profile) is cls)
    texts = [f"{profile.name}: {profile.doc}", f"kind {kind}: {_doc(cls)}"]
    texts += ["its neurons run programs: resonators too"] * profile.programmable
    texts += ["no synapse can have a delay of its own"] * (not profile.delays_synapses)
    return texts + ["costs are given as intervals only"] * profile.interval_only


def _figures(name: str) -> list[Row]:
    """Return the numbers of a hardware profile (name or file) as it states them."""
    from dse.measure.hardware.profile import load

    profile = load(name)
    return [
        {"key": key, **vars(getattr(profile, key)), "doc": figure.doc}
        for key, figure in profile.numbers().items()
        if key in profile.stated
    ]


def _evidence(section: str, preset: Preset) -> list[Row]:
    """Return the numbers of a preset: value, unit, evidence and source."""
    from dse.scene.scene import Camera, Sensor, Texture

    numbers = {**preset.numbers, **{f"camera.{key}": number for key, number in preset.camera.items()}}
    rules = {
        prefix + field.name: rule_of(field)
        for prefix, cls in (("", Texture if section == "scene.textures" else Sensor), ("camera.", Camera))
        for field in dataclasses.fields(cls)
    }
    return [
        {
            "key": key,
            "value": echo(number.value),
            "unit": rules[key].unit,
            "evidence": number.evidence,
            "doc": rules[key].doc,
            "source": number.source,
        }
        for key, number in numbers.items()
    ]


def _row(name: str, key: Key, with_axes: bool) -> Row:
    rule = key.rule
    default = "required"
    if key.default is not None:
        default = echo({} if dataclasses.is_dataclass(key.default) else key.default())
    words, null, _ = expected(key.hint).partition(" or null")
    must = " ".join(filter(None, [words, bounds(rule)])) + null
    if rule.choices:
        must = "one of " + ", ".join(map(str, rule.choices))
    return {
        "key": name,
        "must_be": must,
        "unit": rule.unit,
        "default": default,
        "axis": "yes" if with_axes and rule.axis else "no",
        "doc": rule.doc,
    }


def _doc(cls: type) -> str:
    return (inspect.getdoc(cls) or "").split("\n", 1)[0]
