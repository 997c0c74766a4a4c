"""What `dse describe` says of scenes: it is read from the code and the data files themselves."""

from __future__ import annotations

import dataclasses

import pytest

from dse.cli import reference
from dse.scene import presets
from dse.scene.load import SceneFile
from dse.scene.scene import Camera, Method, Sensor, Variation

SCENE = [row["section"] for row in reference.sections() if row["section"].split(".")[0] == "scene"]


def test_the_sections_of_a_scene_follow_those_of_a_search_space() -> None:
    sections = [row["section"] for row in reference.sections()]
    assert sections[-len(SCENE) :] == SCENE
    assert SCENE[0] == "scene"
    assert {name.partition(".")[2] for name in SCENE[1:]} < {
        field.name for field in dataclasses.fields(SceneFile)
    }


@pytest.mark.parametrize("section", SCENE)
def test_every_section_and_name_has_its_keys(section: str) -> None:
    known = reference.names(section)
    for name in [row["name"] for row in known] or [None]:
        rows = reference.keys(section, name)
        assert rows
        assert all(row["key"] and row["doc"] for row in rows), (section, name)


@pytest.mark.parametrize(
    ("section", "cls"),
    [
        ("scene", SceneFile),
        ("scene.camera", Camera),
        ("scene.variation", Variation),
        ("scene.method", Method),
    ],
)
def test_keys_are_those_of_the_record(section: str, cls: type) -> None:
    assert reference.names(section) == []
    assert [row["key"] for row in reference.keys(section, None)] == [f.name for f in dataclasses.fields(cls)]


def test_where_an_axis_stands_for_several() -> None:
    axes = {row["key"]: row["axis"] for row in reference.keys("scene.motions", "constant")}
    assert axes == {"speed_mm_s": "yes", "travel_mm": "yes", "acceleration_mm_s2": "yes", "name": "no"}
    assert {row["axis"] for row in reference.keys("scene.method", None)} == {"no"}


def test_a_sensor_says_what_is_assumed() -> None:
    assert [row["name"] for row in reference.names("scene.sensor")] == list(presets.sensors())
    rows = {row["key"]: row for row in reference.keys("scene.sensor", "davis240_49")}
    assert set(rows) == {field.name for field in dataclasses.fields(Sensor)} | {
        f"camera.{field.name}" for field in dataclasses.fields(Camera)
    }
    assert rows["pin_radius_mm"] == {
        "key": "pin_radius_mm",
        "value": "0.5",
        "unit": "mm",
        "evidence": "assumed",
        "doc": "radius of a pin's image [A]",
        "source": "4.4 px",
    }
    assert rows["frame_px"]["evidence"] == "seen"
    assert rows["camera.refractory_us"]["value"] == "500"


def test_a_texture_says_that_all_of_it_is_assumed() -> None:
    rows = {row["key"]: row for row in reference.keys("scene.textures", "denim")}
    assert {row["evidence"] for row in rows.values()} == {"assumed"}
    assert (rows["modulus_mpa"]["value"], rows["modulus_mpa"]["doc"]) == ("1", "modulus")
    assert rows["weave_angle_deg"]["unit"] == "deg"
