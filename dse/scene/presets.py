"""The sensors and textures that come with the package, and how far each of their numbers can be trusted.

Their data are `sensors.yaml` and `textures.yaml` beside this file: adding a preset is adding an entry there.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from typing import Any, Literal, get_args

from dse.config.yaml_lines import parse

Evidence = Literal["seen", "memory", "assumed"]
"""seen: read in the named source; memory: not looked up; assumed: our choice, or tuned."""

NUMBERS_OF_A_SENSOR = ("sensor", "camera")


@dataclass(frozen=True)
class Number:
    """A value of a preset, where it is from, and how far it can be trusted."""

    value: Any
    evidence: Evidence
    source: str


@dataclass(frozen=True)
class Preset:
    """Keys of a record with their numbers.

    numbers: for a texture the keys of scene.Texture; for a sensor those of scene.Sensor.
    camera: for a sensor the keys of scene.Camera.
    """

    doc: str
    numbers: Mapping[str, Number]
    camera: Mapping[str, Number]

    def values(self) -> dict[str, Any]:
        """Return key -> value of the numbers."""
        return {key: number.value for key, number in self.numbers.items()}

    def camera_values(self) -> dict[str, Any]:
        """Return key -> value of the camera's numbers."""
        return {key: number.value for key, number in self.camera.items()}


@functools.cache
def sensors() -> Mapping[str, Preset]:
    """Return the shipped sensors by name."""
    data = _data("sensors.yaml")
    sensors = {}
    for name, keys in data["sensors"].items():
        base = data["sensors"].get(keys.get("like"), {})
        numbers, camera = (
            {
                key: _number(number)
                for key, number in {**data["common"][part], **base.get(part, {}), **keys[part]}.items()
            }
            for part in NUMBERS_OF_A_SENSOR
        )
        sensors[name] = Preset(keys["doc"], numbers, camera)
    return sensors


@functools.cache
def textures() -> Mapping[str, Preset]:
    """Return the shipped textures by name."""
    data = _data("textures.yaml")
    textures = {}
    for name, keys in data["textures"].items():
        numbers = {key: _number({**data["common"], "value": value}) for key, value in keys.items()}
        sets = [each for each, names in data["sets"].items() if name in names]
        doc = f"of {' and '.join(sets)}" if sets else "set pin_radius_mm; 0 is a flat plate"
        textures[name] = Preset(f"{doc}; every number assumed", numbers, {})
    return textures


@functools.cache
def texture_sets() -> Mapping[str, tuple[str, ...]]:
    """Return the names that stand for several textures, in the order of their source."""
    return {name: tuple(names) for name, names in _data("textures.yaml")["sets"].items()}


def _number(keys: Mapping[str, Any]) -> Number:
    value = tuple(keys["value"]) if isinstance(keys["value"], list) else keys["value"]
    if keys["evidence"] not in get_args(Evidence):
        raise ValueError(f"evidence must be one of {', '.join(get_args(Evidence))}, got {keys['evidence']}")
    return Number(value, keys["evidence"], keys["source"])


@functools.cache
def _data(name: str) -> Any:
    text = (resources.files("dse.scene") / name).read_text(encoding="utf-8")
    return parse(text, name).data
