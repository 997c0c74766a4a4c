"""The shipped sensors and textures: their numbers, their evidence, and that they obey the rules of a file."""

import dataclasses
from pathlib import Path
from typing import get_args

import pytest

from dse.config.values import read_fields
from dse.config.yaml_lines import parse
from dse.scene import presets
from dse.scene.scene import Camera, Sensor, Texture
from dse.scene.tip import pins_mm

DATA = Path(presets.__file__).parent
# rms um, wavelength mm, octaves, weave (share, period, angle), grain, MPa, mu_s, mu_k, v_s, jitter, eta
TABLE = {
    "aluminium": (2, 1.5, 0.8, None, 3, 70000, 0.52, 0.45, 4, 0.15, 0.02),
    "acrylic": (1.5, 2, 0.8, None, 1, 3000, 0.68, 0.58, 5, 0.15, 0.03),
    "mdf": (8, 1.2, 0.7, None, 1, 3000, 0.49, 0.44, 3, 0.2, 0.03),
    "plywood": (10, 1.4, 0.8, (0.1, 2.4, 0), 2.5, 5000, 0.51, 0.45, 3, 0.2, 0.035),
    "fake_leather": (30, 1.8, 0.5, None, 1, 20, 0.66, 0.6, 4, 0.2, 0.03),
    "denim": (55, 1, 0.4, (0.6, 1.05, 55), 1, 1, 0.4, 0.36, 2.5, 0.25, 0.045),
    "silicone": (3, 3, 0.8, None, 1, 1, 0.98, 0.85, 6, 0.15, 0.025),
    "foam": (90, 1.6, 0.5, None, 1, 0.05, 0.79, 0.72, 4, 0.25, 0.045),
    "satin": (18, 0.8, 0.4, (0.5, 0.8, 20), 1.5, 1, 0.3, 0.27, 2.5, 0.2, 0.025),
    "velvet": (45, 1.1, 0.5, (0.3, 1.2, 0), 1, 0.1, 0.44, 0.4, 2.5, 0.3, 0.04),
    "fake_fur": (220, 4, 0.7, None, 0.5, 0.02, 0.37, 0.34, 2.5, 0.35, 0.05),
    "wool": (85, 2.2, 0.6, (0.3, 2.5, 80), 1, 0.1, 0.39, 0.35, 2.5, 0.3, 0.055),
    "microdot": (12, 1, 0.2, (0.9, 1, 45), 1, 100, 0.46, 0.4, 4, 0.15, 0.035),
    "mesh": (70, 1.3, 0.2, (0.9, 1.3, 0), 1, 1000, 0.4, 0.36, 2.5, 0.2, 0.045),
    "felt": (60, 1.7, 0.8, None, 1, 0.3, 0.4, 0.36, 2.5, 0.3, 0.045),
    "fleece": (110, 2.6, 0.7, None, 1, 0.05, 0.38, 0.34, 2.5, 0.3, 0.05),
}


def texture(name):
    return Texture(name, **presets.textures()[name].values())


def test_the_data_files_have_no_faults():
    for name in ("sensors.yaml", "textures.yaml"):
        assert parse((DATA / name).read_text(encoding="utf-8"), name).faults == []


def test_the_textures_of_the_table_are_shipped():
    assert list(presets.textures()) == [*TABLE, "printed_pins"]


@pytest.mark.parametrize("name", TABLE)
def test_every_number_of_the_table(name):
    x = texture(name)
    weave = (x.weave_share, x.weave_period_mm, x.weave_angle_deg) if x.weave_share else None
    found = (
        *(x.rms_um, x.wavelength_mm, x.bandwidth_oct, weave, x.grain, x.modulus_mpa, x.mu_static),
        *(x.mu_kinetic, x.stribeck_mm_s, x.slip_jitter, x.friction_roughness),
    )
    assert found == TABLE[name]
    assert x.pin_radius_mm is None


def test_sets_of_textures():
    sets = presets.texture_sets()
    assert {name: len(names) for name, names in sets.items()} == {"neurotac_12": 12, "neurotac_11": 11}
    assert sets["neurotac_12"] == tuple(list(TABLE)[:12])
    assert sets["neurotac_11"][4:7] == ("microdot", "mesh", "felt")
    assert all(name in TABLE for names in sets.values() for name in names)


@pytest.mark.parametrize(
    ("name", "n_pins", "frame", "scale", "pitch", "radius", "refractory"),
    [
        ("davis240_49", 49, (160, 160), 8.8, 2.5, 0.5, 500),
        ("dvxplorer_331", 331, (312, 312), 10.4, 1.35, 0.40, 100),
    ],
)
def test_sensors(name, n_pins, frame, scale, pitch, radius, refractory):
    preset = presets.sensors()[name]
    sensor, camera = Sensor(**preset.values()), Camera(**preset.camera_values())
    assert len(pins_mm(sensor)) == n_pins
    assert sensor.frame_px == frame
    found = (sensor.image_scale_px_mm, sensor.pin_pitch_mm, sensor.pin_radius_mm, camera.refractory_us)
    assert found == (scale, pitch, radius, refractory)
    common = (sensor.rim_mm, sensor.modulus_mpa, sensor.stiffness_n_mm, sensor.lever_mm, sensor.corner_hz)
    assert common == (18, 0.06, 0.9, 4, 100)


@pytest.mark.parametrize("name", presets.sensors())
def test_a_sensor_gives_every_number_with_its_evidence(name):
    preset = presets.sensors()[name]
    assert preset.doc
    for cls, numbers in ((Sensor, preset.numbers), (Camera, preset.camera)):
        assert set(numbers) == {field.name for field in dataclasses.fields(cls)}
        assert all(
            number.evidence in get_args(presets.Evidence) and number.source for number in numbers.values()
        )


@pytest.mark.parametrize(("name", "stiffness"), [("davis240_49", 0.15), ("dvxplorer_331", 0.25)])
def test_a_soft_tip_has_the_other_numbers_of_the_stiff_one(name, stiffness):
    stiff, soft = presets.sensors()[name], presets.sensors()[f"{name}_soft"]
    assert (stiff.values()["incipient_slip"], soft.values()["incipient_slip"]) == (False, True)
    assert soft.values()["stiffness_n_mm"] == stiffness
    same = ("layout", "n_across", "pin_pitch_mm", "frame_px", "modulus_mpa", "dome_radius_mm", "corner_hz")
    assert [soft.numbers[key] for key in same] == [stiff.numbers[key] for key in same]
    changed = {key for key, number in soft.camera.items() if number != stiff.camera[key]}
    assert changed == {"contrast", "refractory_us"}


def test_what_was_assumed_says_so():
    for preset in presets.textures().values():
        assert {number.evidence for number in preset.numbers.values()} == {"assumed"}
    numbers = presets.sensors()["dvxplorer_331"].numbers
    assert [numbers[key].evidence for key in ("frame_px", "dome_radius_mm", "lever_mm")] == [
        "seen",
        "memory",
        "assumed",
    ]


def test_presets_obey_the_rules_of_a_file():
    faults = []

    def report(path, message):
        faults.append(message)

    for preset in presets.sensors().values():
        read_fields(Sensor, preset.values(), ("sensor",), report)
        read_fields(Camera, preset.camera_values(), ("camera",), report)
    for name, preset in presets.textures().items():
        read_fields(Texture, {"name": name, **preset.values()}, ("textures", name), report)
    assert faults == []
