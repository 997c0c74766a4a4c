"""Scene file -> `Scene`, or every fault in it at once.

A shipped sensor or texture is named, or named with numbers that differ: `{preset: denim, rms_um: 60}`.
An axis in place of a texture's or motion's number stands for one of them per value:
`{kind: constant, speed_mm_s: {choice: [20, 40]}}` is two motions.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from dse.base import registry
from dse.base.registry import fixed, param
from dse.config.axes import Axis
from dse.config.faults import known_names
from dse.config.locate import find_file, shipped_folder, yaml_files
from dse.config.parts import read_fixed, read_or_axis
from dse.config.values import INVALID, Report, dotted, echo, read_fields, read_object
from dse.config.yaml_lines import Document, read_document
from dse.config.yaml_lines import Path as Keys
from dse.scene import checks, presets
from dse.scene.scene import Camera, Method, Motion, Scene, Sensor, Texture, Variation


@dataclass(frozen=True)
class SceneFile:
    """The keys of a scene file."""

    scene: str = fixed(doc="name of the scene")
    sensor: str | Mapping[str, Any] = fixed(
        doc="name of a shipped sensor, `{preset: NAME, ...}` to change some of its numbers, or all numbers "
        "of your own"
    )
    textures: tuple[str | Mapping[str, Any], ...] = fixed(
        doc="names of shipped textures or of sets of them, `{preset: NAME, ...}` to change some numbers, or "
        "all numbers of your own; an axis (choice or range) stands for one texture per value"
    )
    motions: tuple[Mapping[str, Any], ...] = fixed(
        doc="velocity profiles; `kind` names a component; an axis (choice or range) stands for one motion "
        "per value"
    )
    forces_n: tuple[float, ...] = param((1.51,), doc="mean normal forces of the touches", unit="N", low=0)
    randomised_force_n: tuple[float, float] | None = fixed(
        None,
        doc="one more force, drawn anew in every trial, evenly between these two; column randomised_force "
        "is 1 in its trials",
        unit="N",
        low=0,
    )
    trials: int = fixed(1, doc="trials of each texture, motion and force", low=1)
    duration_ms: float = fixed(1000.0, doc="duration of a trial", unit="ms", low=0, low_open=True)
    seed: int = fixed(0, doc="seed of all random numbers of the scene", low=0)
    camera: Mapping[str, Any] | None = fixed(
        None, doc="changed numbers of the camera (`dse describe scene.camera`)"
    )
    variation: Mapping[str, Any] | None = fixed(
        None, doc="changed numbers of the variation between trials (`dse describe scene.variation`)"
    )
    method: Mapping[str, Any] | None = fixed(
        None, doc="changed steps of the simulation (`dse describe scene.method`)"
    )


def load_scene(
    path_or_name: str | Path, overrides: Mapping[str, str] | None = None, *, base: Path | None = None
) -> Scene:
    """Read and validate a scene of a file, looked up in `base` first, or of a shipped name.

    overrides: dotted key -> YAML text that replaces the file's value.

    Raises:
        ConfigError: with every fault of the file and of the overrides.
    """
    source = find_scene(str(path_or_name), base)
    document = read_document(source, overrides or {})
    scene = _scene(document) if document.data or not document.faults else None
    document.check()
    assert scene is not None  # else there were faults
    return scene


def find_scene(path_or_name: str, base: Path | None = None) -> Path:
    """Return the file of a scene given by path or by the name of a shipped one.

    Raises:
        ConfigError: there is neither.
    """
    return find_file(path_or_name, shipped_scenes(), "scene", base)


def shipped_scenes() -> dict[str, Path]:
    """Return the scenes that come with the package, by name."""
    return yaml_files(shipped_folder("search_spaces") / "scenes")


def _scene(document: Document) -> Scene | None:
    data, report = document.data, document.report
    if not isinstance(data, dict):
        report((), f"a scene must be a mapping of keys to values, got {echo(data)}")
        return None
    keys = _keys(data, report)
    sensor, of_camera = _sensor(keys.get("sensor", INVALID), report)
    camera = read_object(Camera, {**of_camera, **(keys.get("camera") or {})}, ("camera",), report, read_fixed)
    variation = read_object(Variation, keys.get("variation"), ("variation",), report, read_fixed)
    method = read_object(Method, keys.get("method"), ("method",), report, read_fixed)
    textures = _textures(keys.get("textures", ()), report)
    motions = _motions(keys.get("motions", ()), report)
    forces = keys.get("forces_n", ())
    forces = cast("tuple[float, ...]", forces.values or ()) if isinstance(forces, Axis) else forces
    _no_twins([(f"{force:g} N", ("forces_n", i)) for i, force in enumerate(forces)], report)
    randomised = keys.get("randomised_force_n")
    if randomised is not None and randomised[0] > randomised[1]:
        text = f"randomised_force_n must be in increasing order, got [{randomised[0]:g}, {randomised[1]:g}]"
        report(("randomised_force_n",), text)
    if variation is not None:
        _report_all(checks.variation_faults(variation), ("variation",), report)
    if sensor is not None and method is not None:
        for motion, _ in motions:
            _report_all(checks.step_faults(method, sensor, motion), ("method",), report)
    if document.faults or sensor is None or camera is None or variation is None or method is None:
        return None
    return Scene(
        name=keys["scene"], seed=keys["seed"], sensor=sensor, camera=camera,
        textures=tuple(texture for texture, _ in textures), motions=tuple(motion for motion, _ in motions),
        forces_n=tuple(float(force) for force in forces), trials=keys["trials"],
        duration_ms=keys["duration_ms"], variation=variation, method=method, randomised_force_n=randomised,
    )  # fmt: skip


def _keys(data: Mapping[str, Any], report: Report) -> dict[str, Any]:
    """Return the keys of the file that are right, each in its type; absent ones have their default."""
    keys, _ = read_fields(SceneFile, data, (), report, read_or_axis)
    for key in ("textures", "motions", "forces_n"):
        if keys.get(key) == ():
            report((key,), f"{key} must contain at least one, got []")
        values = keys.get(key)
        if isinstance(values, Axis) and values.values is None:
            report((key, "range"), f"{key} is a list, so its range needs a step")
    return keys


def _sensor(raw: Any, report: Report) -> tuple[Sensor | None, dict[str, Any]]:
    """Return the sensor, and the numbers of its camera as far as a preset gives them."""
    if raw is INVALID:
        return None, {}
    keys = {"preset": raw} if isinstance(raw, str) else dict(raw)
    known = presets.sensors()
    name = keys.pop("preset", None)
    if name is not None and name not in known:
        where = ("sensor",) if isinstance(raw, str) else ("sensor", "preset")
        report(where, f"unknown sensor {echo(name)}; {known_names(str(name), known)}")
        return None, {}
    preset = {} if name is None else known[name].values()
    camera = {} if name is None else known[name].camera_values()
    sensor = read_object(Sensor, {**preset, **keys}, ("sensor",), report, read_fixed)
    if sensor is not None:
        _report_all(checks.sensor_faults(sensor), ("sensor",), report)
    return sensor, camera


def _textures(raw: Iterable[Any], report: Report) -> list[tuple[Texture, Keys]]:
    """Return the textures, each with the place in the file that it comes from."""
    known, sets = presets.textures(), presets.texture_sets()
    textures: list[tuple[Texture, Keys]] = []
    for index, entry in enumerate(raw):
        where: Keys = ("textures", index)
        if isinstance(entry, str) and entry not in known and entry not in sets:
            report(where, f"unknown texture '{entry}'; {known_names(entry, [*known, *sets])}")
            continue
        keys = {"preset": entry} if isinstance(entry, str) else entry
        group = sets.get(str(keys.get("preset")))
        for one in [{**keys, "preset": name} for name in group] if group else [keys]:
            for texture in _varied(one, where, report):
                _report_all(checks.texture_faults(texture), where, report)
                textures.append((texture, where))
    _no_twins([(texture.name, where) for texture, where in textures], report)
    return textures


def _varied(keys: Mapping[str, Any], where: Keys, report: Report) -> list[Texture]:
    """Return the texture of one mapping, or one per value of its axes; none after a fault."""
    known = presets.textures()
    name = keys.get("preset", keys.get("name"))
    if "preset" in keys and name not in known:
        names = known_names(str(name), [*known, *presets.texture_sets()])
        report((*where, "preset"), f"unknown texture {echo(name)}; {names}")
        return []
    written = {key: value for key, value in keys.items() if key != "preset"}
    if name not in known:
        required = [f.name for f in dataclasses.fields(Texture) if f.default is dataclasses.MISSING]
        if missing := [key for key in required if key not in written]:
            called = f" '{name}'" if name is not None else ""
            text = f"{dotted(where)}{called} is not a shipped texture and must have {', '.join(missing)}"
            report(where, f"{text}; {known_names(str(name or ''), known)}")
            read_fields(Texture, written, where, report, read_or_axis, has_defaults=False)
            return []
    values = {"name": name, **(known[name].values() if name in known else {}), **written}
    fields, good = read_fields(Texture, values, where, report, read_or_axis)
    return [Texture(**one) for one in _combinations(fields, where, report)] if good else []


def _motions(raw: Iterable[Mapping[str, Any]], report: Report) -> list[tuple[Motion, Keys]]:
    """Return the motions, each with the place in the file that it comes from."""
    known = registry.known("scene.motions")
    motions: list[tuple[Motion, Keys]] = []
    for index, entry in enumerate(raw):
        where: Keys = ("motions", index)
        kind = entry.get("kind")
        if "kind" not in entry:
            report(where, f"{dotted(where)}.kind is required; {known_names('', known)}")
            continue
        if not isinstance(kind, str) or kind not in known:
            report(
                (*where, "kind"),
                f"unknown {dotted(where)}.kind {echo(kind)}; {known_names(str(kind), known)}",
            )
            continue
        keys = {key: value for key, value in entry.items() if key != "kind"}
        fields, good = read_fields(known[kind], keys, where, report, read_or_axis)
        for one in _combinations(fields, where, report) if good else ():
            try:
                motions.append((known[kind](**one), where))
            except ValueError as error:
                # A component's own sentence begins with the key that it is about.
                report((*where, str(error).split(" ", 1)[0]), f"{dotted(where)}.{error}")
    _no_twins([(motion.label, where) for motion, where in motions], report)
    return motions


def _combinations(fields: Mapping[str, Any], where: Keys, report: Report) -> list[dict[str, Any]]:
    """Return one set of fields per combination of their axes; a given name gets the values appended."""
    axes = {key: value for key, value in fields.items() if isinstance(value, Axis)}
    for key, axis in axes.items():
        if axis.values is None:
            text = f"{dotted((*where, key))} stands for one per value, so its range needs a step"
            report((*where, key, "range"), text)
    combinations = []
    for values in itertools.product(*(axis.values or () for axis in axes.values())):
        name = "_".join([fields["name"], *map(_short, values)]) if fields["name"] else ""
        combinations.append({**fields, **dict(zip(axes, values, strict=True)), "name": name})
    return combinations


def _short(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _no_twins(named: list[tuple[str, Keys]], report: Report) -> None:
    """Report names that two trials would share: what happens in a trial follows from them."""
    first: dict[str, Keys] = {}
    for name, where in named:
        if name in first:
            report(
                where, f"{dotted(where)} repeats '{name}' of {dotted(first[name])}; names must be distinct"
            )
        first.setdefault(name, where)


def _report_all(sentences: Iterable[checks.Sentence], where: Keys, report: Report) -> None:
    for key, text in sentences:
        report((*where, key), f"{dotted((*where, key))} {text}")
