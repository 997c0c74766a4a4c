"""Scene files: what they may say, and every fault with its line."""

import dataclasses
import math
import re

import pytest

from dse.config import ConfigError
from dse.scene import checks
from dse.scene.load import SceneFile, find_scene, load_scene, shipped_scenes
from dse.scene.motions.constant import Constant
from dse.scene.scene import Camera, Method, Sensor, Variation
from dse.scene.tip import image_px, pins_mm

SCENE = """\
scene: tiny
seed: 3
sensor: davis240_49
textures: [denim, foam]
motions:
  - {kind: constant, speed_mm_s: 20}
  - {kind: triangular, peak_mm_s: 40}
forces_n: [1.0, 1.5]
trials: 2
duration_ms: 500
"""
OWN_SENSOR = """{layout: rings, n_across: 3, pin_pitch_mm: 1.5, image_scale_px_mm: 10, frame_px: [120, 110], \
pin_radius_mm: 0.4}"""


@pytest.fixture
def write(tmp_path):
    def save(*changes):
        text = SCENE
        for old, new in changes:
            assert old in text, old
            text = text.replace(old, new)
        path = tmp_path / "tiny.yaml"
        path.write_text(text, encoding="utf-8")
        return path

    return save


def faults_of(path, overrides=None):
    """Return the faults without the name of the file."""
    with pytest.raises(ConfigError) as caught:
        load_scene(path, overrides)
    return [str(fault).removeprefix(f"{path}:") for fault in caught.value.faults]


def test_a_file_without_faults(write):
    scene = load_scene(write())
    assert (scene.name, scene.seed, scene.trials, scene.duration_ms) == ("tiny", 3, 2, 500.0)
    assert [texture.name for texture in scene.textures] == ["denim", "foam"]
    assert [motion.label for motion in scene.motions] == ["constant_20", "triangular_40"]
    assert scene.forces_n == (1.0, 1.5)
    assert scene.sensor.n_across == 7
    assert scene.camera.refractory_us == 500.0
    assert (scene.variation, scene.method) == (Variation(), Method())
    assert type(scene.textures[0].rms_um) is float  # written 55


def test_defaults():
    defaults = {field.name: field.default for field in dataclasses.fields(SceneFile)}
    assert [name for name, value in defaults.items() if value is dataclasses.MISSING] == [
        *("scene", "sensor", "textures", "motions")
    ]
    assert (defaults["forces_n"], defaults["trials"], defaults["duration_ms"]) == ((1.51,), 1, 1000.0)


def test_trials_in_order(write):
    scene = load_scene(write())
    assert scene.n_trials == 2 * 2 * 2 * 2
    cells = [scene.cell(k) for k in range(scene.n_trials)]
    assert cells == sorted(cells)
    assert cells[:5] == [(0, 0, 0, 0), (0, 0, 0, 1), (0, 0, 1, 0), (0, 0, 1, 1), (0, 1, 0, 0)]
    assert cells[-1] == (1, 1, 1, 1)


def test_numbers_that_differ_from_a_preset(write):
    scene = load_scene(
        write(
            ("sensor: davis240_49", "sensor: {preset: davis240_49, lever_mm: 2}"),
            ("[denim, foam]", "[{preset: denim, rms_um: 60}, {preset: foam, name: old, mu_static: 0.9}]"),
            ("trials: 2", "camera: {noise_hz: 0}\nvariation: {force_n: 0}\nmethod: {skip_px: 0}"),
        )
    )
    assert (scene.sensor.lever_mm, scene.sensor.n_across) == (2, 7)
    assert (scene.textures[0].name, scene.textures[0].rms_um, scene.textures[0].modulus_mpa) == (
        "denim",
        60,
        1,
    )
    assert (scene.textures[1].name, scene.textures[1].mu_static, scene.textures[1].rms_um) == ("old", 0.9, 90)
    assert (scene.camera.noise_hz, scene.camera.refractory_us) == (0, 500)
    assert scene.variation == Variation(force_n=0)
    assert scene.method == Method(skip_px=0)


def test_own_numbers(write):
    own = (
        "{name: brick, rms_um: 40, wavelength_mm: 2, bandwidth_oct: 0.5, modulus_mpa: 900, mu_static: 0.6, "
        "mu_kinetic: 0.5, stribeck_mm_s: 3, slip_jitter: 0.2, friction_roughness: 0.03}"
    )
    scene = load_scene(write(("sensor: davis240_49", f"sensor: {OWN_SENSOR}"), ("[denim, foam]", f"[{own}]")))
    assert scene.sensor == Sensor("rings", 3, 1.5, 10, (120, 110), 0.4)
    assert scene.camera == Camera()
    assert (scene.textures[0].name, scene.textures[0].grain) == ("brick", 1.0)


def test_the_name_of_a_shipped_texture_is_enough(write):
    (texture,) = load_scene(write(("[denim, foam]", "[{name: wool, rms_um: 9}]"))).textures
    assert (texture.name, texture.rms_um, texture.weave_angle_deg) == ("wool", 9, 80)


def test_a_set_of_textures(write):
    scene = load_scene(write(("[denim, foam]", "[neurotac_11, denim]")))
    assert len(scene.textures) == 12
    assert scene.textures[-1].name == "denim"


def test_axes_stand_for_one_per_value(write):
    scene = load_scene(
        write(
            ("speed_mm_s: 20", "speed_mm_s: {choice: [20, 17.5]}"),
            (
                "[denim, foam]",
                "[{preset: printed_pins, name: pins, pin_radius_mm: {range: [0, 1], step: 0.5}}, "
                "{preset: felt, rms_um: {choice: [1, 2]}, mu_static: {choice: [0.5, 0.6]}}]",
            ),
            ("[1.0, 1.5]", "{range: [0.8, 1.2], step: 0.2}"),
        )
    )
    assert [motion.label for motion in scene.motions] == ["constant_20", "constant_17.5", "triangular_40"]
    assert [texture.name for texture in scene.textures] == [
        *("pins_0", "pins_0.5", "pins_1"),
        *("felt_1_0.5", "felt_1_0.6", "felt_2_0.5", "felt_2_0.6"),
    ]
    assert [texture.pin_radius_mm for texture in scene.textures[:3]] == [0, 0.5, 1]
    assert scene.forces_n == (0.8, 1.0, 1.2)


def test_one_word_stands_for_a_list_of_one(write):
    scene = load_scene(write(("[denim, foam]", "neurotac_12"), ("[1.0, 1.5]", "1")))
    assert (len(scene.textures), scene.forces_n) == (12, (1.0,))


def test_overrides(write):
    scene = load_scene(write(), {"trials": "5", "textures": "[wool]", "camera.noise_hz": "0"})
    assert (scene.trials, scene.textures[0].name, scene.camera.noise_hz) == (5, "wool", 0)
    assert faults_of(write(), {"trials": "0"}) == ["--set trials: trials must be >= 1, got 0"]


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("seed: 3", "sed: 3", 2, "unknown key 'sed'; known: scene, .*Did you mean 'seed'"),
        ("scene: tiny", "textur: 3", 1, "scene is required: name of the scene"),
        ("sensor: davis240_49", "sensor: davis240", 3, "unknown sensor 'davis240'; .*'davis240_49'"),
        ("sensor: davis240_49", "sensor: {preset: davis}", 3, "unknown sensor 'davis'"),
        ("sensor: davis240_49", "sensor: {layout: rings}", 3, r"sensor\.n_across is required"),
        ("sensor: davis240_49", "sensor: [1]", 3, "sensor must be text or a mapping, got"),
        ("[denim, foam]", "[denin]", 4, "unknown texture 'denin'; .*Did you mean 'denim'"),
        ("[denim, foam]", "[{preset: denin}]", 4, "unknown texture 'denin'; .*Did you mean 'denim'"),
        ("[denim, foam]", "[{name: denin, rms_um: 3}]", 4, r"textures\[0\] 'denin' is not a shipped"),
        ("[denim, foam]", "[{rms_um: 3}]", 4, r"textures\[0\] is not a shipped .* must have name, wave"),
        ("[denim, foam]", "[{preset: neurotac12}]", 4, "unknown texture 'neurotac12'; .*mean 'neurotac_12'"),
        ("[denim, foam]", "[{preset: neurotac_12, name: all}]", 4, "repeats 'all' of textures"),
        ("[denim, foam]", "[{preset: denim, rms: 3}]", 4, r"unknown key 'textures\[0\]\.rms'"),
        ("[denim, foam]", "[{preset: denim, rms_um: -1}]", 4, r"textures\[0\]\.rms_um must be >= 0, got -1"),
        ("[denim, foam]", "[{preset: denim, name: ''}]", 4, r"textures\[0\]\.name must not be empty"),
        ("[denim, foam]", "[]", 4, "textures must contain at least one"),
        ("[denim, foam]", "[denim, denim]", 4, r"textures\[1\] repeats 'denim' of textures\[0\]"),
        ("[denim, foam]", "[neurotac_11, foam]", 4, r"textures\[1\] repeats 'foam' of textures\[0\]"),
        ("kind: constant", "kind: constnt", 6, r"unknown motions\[0\]\.kind 'constnt'; .*'constant'"),
        ("kind: constant, ", "", 6, r"motions\[0\]\.kind is required; known: accelerating, constant"),
        ("speed_mm_s: 20", "speed: 20", 6, r"unknown key 'motions\[0\]\.speed'"),
        ("speed_mm_s: 20", "speed_mm_s: {range: [1, 20]}", 6, "range needs a step"),
        ("{kind: triangular, peak_mm_s: 40}", "{kind: constant, speed_mm_s: 20}", 7,
         "repeats 'constant_20' of"),
        ("{kind: triangular, peak_mm_s: 40}", "{kind: table, t_s: [0, 1], v_mm_s: [1]}", 7,
         r"motions\[1\]\.v_mm_s must have one speed for each of 2 times"),
        ("[1.0, 1.5]", "[1, 1.0]", 8, r"forces_n\[1\] repeats '1 N' of forces_n\[0\]"),
        ("[1.0, 1.5]", "-1", 8, "must be >= 0, got -1"),
        ("[1.0, 1.5]", "{range: [1, 2]}", 8, "forces_n is a list, so its range needs a step"),
        ("trials: 2", "trials: 2.5", 9, "trials must be an integer, got 2.5"),
        ("duration_ms: 500", "duration_ms: 0", 10, "duration_ms must be > 0, got 0"),
        ("duration_ms: 500", "camera: {threshold: 0}", 10, r"camera\.threshold must be >= 0\.02"),
        ("duration_ms: 500", "variation: 3", 10, "variation must be a mapping, got 3"),
        ("duration_ms: 500", "variation: {ripple_hz: [9, 2]}", 10, "ripple_hz must be in increasing order"),
        ("duration_ms: 500", "duration_ms: [", 11, "not valid YAML"),
    ],
)  # fmt: skip
def test_each_fault_with_its_line(write, old, new, line, message):
    found = faults_of(write((old, new)))
    hits = [fault for fault in found if re.search(message, fault)]
    assert hits, found
    assert hits[0].startswith(f"{line}: ")


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("foam", "{preset: foam, mu_kinetic: 0.8}", 4, "textures[1].mu_kinetic must be at most mu_static"),
        ("foam", "{preset: foam, weave_share: 0.5}", 4, "textures[1].weave_period_mm must be given with"),
        ("foam", "{preset: printed_pins, pin_radius_mm: 0.1}", 4, "textures[1].pin_radius_mm must be 0"),
        ("sensor: davis240_49", "sensor: {preset: davis240_49, frame_px: [200, 140]}", 3,
         "sensor.frame_px must contain the image of the pins, 141 x 141 px, got 200 x 140"),
        ("sensor: davis240_49", "sensor: {preset: davis240_49, pin_pitch_mm: 0.9}", 3,
         "sensor.pin_pitch_mm must be at least a pin's diameter, 1 mm, got 0.9"),
        ("sensor: davis240_49", "sensor: {preset: davis240_49, n_across: 0}", 3, "sensor.n_across must be"),
        ("speed_mm_s: 20", "speed_mm_s: 600, travel_mm: 1000, acceleration_mm_s2: 9000", 1,
         "method.texture_step_ms must be at most 0.209 ms for the 600 mm/s of 'constant_600', got 0.5"),
        *(("trials: 2", f"method: {steps}", 9, f"method.{message}") for steps, message in (
            ("{texture_step_ms: 0.25}", "texture_step_ms must be a multiple of friction_step_ms, 0.1"),
            ("{friction_step_ms: 1}", "texture_step_ms must be a multiple of friction_step_ms, 1 ms"),
            ("{camera_step_ms: 0.4, texture_step_ms: 0.4, friction_step_ms: 0.3}", "texture_step_ms"),
            ("{camera_step_ms: 0.4}", "camera_step_ms must be a multiple of texture_step_ms, 0.5 ms"),
        )),
    ],
)  # fmt: skip
def test_faults_of_physics_and_steps(write, old, new, line, message):
    (found,) = faults_of(write((old, new)))
    assert found.startswith(f"{line}: {message}")


def test_a_shorter_step_admits_a_faster_motion(write):
    fast = ("speed_mm_s: 20", "speed_mm_s: 600, travel_mm: 1000, acceleration_mm_s2: 9000")
    step = ("trials: 2", "method: {texture_step_ms: 0.2}")
    assert load_scene(write(fast, step)).motions[0].peak_mm_s == 600


def test_faults_of_every_part_at_once(write):
    path = write(
        ("sensor: davis240_49", "sensor: {preset: davis240_49, frame_px: [9, 9]}"),
        ("[denim, foam]", "[denin, {preset: foam, mu_kinetic: 2}]"),
        ("speed_mm_s: 20", "speed_mm_s: -1"),
        ("trials: 2", "trials: 0"),
        ("duration_ms: 500", "duratoin_ms: 500"),
    )
    assert [fault.split(":")[0] for fault in faults_of(path)] == ["3", "4", "4", "6", "9", "10"]


@pytest.mark.parametrize(
    ("content", "begins"),
    [
        (b"[1, 2]", ["1: a scene must be a mapping of keys to values, got"]),
        (b"word", ["1: a scene must be a mapping of keys to values, got"]),
        (b"", [f"1: {key} " for key in ("scene", "sensor", "textures", "motions")]),
        (b"\xff\xfe", [" cannot be read: not UTF-8 text"]),
    ],
)
def test_a_file_that_is_no_mapping_or_no_text(tmp_path, content, begins):
    path = tmp_path / "scene.yaml"
    path.write_bytes(content)
    for fault, text in zip(faults_of(path), begins, strict=True):
        assert fault.startswith(text)


def test_finding_scenes(write, tmp_path):
    path = write()
    assert find_scene("tiny.yaml", tmp_path) == path
    assert find_scene(str(path)) == path
    assert find_scene("quickstart", tmp_path) == shipped_scenes()["quickstart"]
    with pytest.raises(
        ConfigError, match=r"no shipped scene of this name; known: .*Did you mean 'quickstart'\?"
    ):
        find_scene("quikstart")


def test_what_is_shipped():
    cells = {
        name: (len(x.textures), len(x.motions), x.n_forces, x.trials, x.duration_ms)
        for name, x in ((name, load_scene(name)) for name in shipped_scenes())
    }
    assert cells == {
        "natural_textures": (11, 1, 1, 100, 5000),
        "natural_textures_soft": (11, 1, 1, 100, 5000),
        "neurotac_davis": (11, 1, 4, 50, 5000),
        "neurotac_davis_soft": (11, 1, 4, 50, 5000),
        "neurotac_dvxplorer": (12, 12, 1, 100, 1000),
        "neurotac_dvxplorer_soft": (12, 12, 1, 100, 1000),
        "neurotac_small": (12, 12, 1, 14, 1000),
        "pin_arrays": (11, 1, 1, 100, 5000),
        "pin_arrays_soft": (11, 1, 1, 100, 5000),
        "quickstart": (6, 4, 1, 20, 1000),
    }


@pytest.mark.parametrize("name", shipped_scenes())
def test_every_shipped_scene_is_sound(name):
    scene = load_scene(name)
    assert scene.name == name
    assert checks.warnings(scene) == []
    px = image_px(scene.sensor, pins_mm(scene.sensor))
    assert (px >= 0).all()
    assert (px <= scene.sensor.frame_px).all()


def test_profiles_of_the_velocity_scene():
    motions = load_scene("neurotac_dvxplorer").motions
    assert max(motion.peak_mm_s for motion in motions) == 60
    assert 1.4 <= min(motion.duration_s for motion in motions) <= 1.5
    assert 4.8 <= max(motion.duration_s for motion in motions) <= 4.83


def test_printed_pins_go_from_flat_to_5_mm():
    scene = load_scene("pin_arrays")
    assert [texture.pin_radius_mm for texture in scene.textures] == [i / 2 for i in range(11)]
    assert scene.textures[0].name == "pins_0"


def test_every_quickstart_motion_ends_within_the_record():
    scene = load_scene("quickstart")
    late = max(motion.duration_s for motion in scene.motions) * 1000 + scene.variation.onset_ms
    assert late + 3 * scene.variation.onset_sd_ms < scene.duration_ms


def test_the_shortest_wave_that_is_felt(write):
    sensor = load_scene(write()).sensor
    f = 1 / checks.shortest_wavelength_mm(sensor)
    gain = math.exp(-2 * math.pi * f * sensor.depth_mm - (2 * math.pi * f * sensor.pin_average_mm) ** 2 / 2)
    assert gain == pytest.approx(1e-3)
    bare = dataclasses.replace(sensor, depth_mm=0.0, pin_average_mm=0.0)
    assert checks.shortest_wavelength_mm(bare) == 0.2


def test_warnings(write):
    assert checks.warnings(load_scene(write())) == []
    blind = load_scene(write(("trials: 2", "camera: {contrast: 1.2}")))
    assert checks.warnings(blind) == [
        "no pixel can send an event: camera.threshold 0.3 is at or above ln(contrast) = 0.182"
    ]
    short = load_scene(write(("duration_ms: 500", "duration_ms: 20")))
    assert checks.warnings(short)[0].startswith("nothing moves: the trial of 20 ms ends before")


def test_zero_speed_and_zero_force_are_legal(write):
    scene = load_scene(write(("speed_mm_s: 20", "speed_mm_s: 0"), ("[1.0, 1.5]", "[0, 1.5]")))
    assert scene.motions[0] == Constant(0.0)
    assert scene.forces_n == (0.0, 1.5)
