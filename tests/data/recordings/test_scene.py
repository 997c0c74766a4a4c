"""Trials of a scene as recordings: columns, overrides, faults, hash, and what is simulated for whom."""

import dataclasses

import numpy as np
import pytest

from dse.data.recordings import RecordingError, trials_of
from dse.data.recordings import scene as scene_module
from dse.data.recordings.scene import COLUMNS, SceneTrials, Trials
from dse.scene import simulate
from dse.scene.load import load_scene
from dse.scene.trial import trial

TINY = """\
scene: tiny
sensor:
  {layout: grid, n_across: 2, pin_pitch_mm: 2.5, image_scale_px_mm: 8, frame_px: [64, 48], pin_radius_mm: 0.5}
textures: [denim, foam, wool]
motions:
  - {kind: constant, speed_mm_s: {choice: [20, 40]}}
forces_n: [1, 1.5]
trials: 2
duration_ms: 120
"""
N = 3 * 2 * 2 * 2


@pytest.fixture
def base(tmp_path):
    (tmp_path / "tiny.yaml").write_text(TINY, encoding="utf-8")
    return tmp_path


def read(base, **keys):
    return SceneTrials("tiny.yaml", **keys).read(base)


def test_a_scene_is_read_again_only_where_its_file_has_changed(base, monkeypatch):
    read = []

    def counted(path):
        read.append(path)
        return load_scene(path)

    monkeypatch.setattr(scene_module, "load_scene", counted)
    source = SceneTrials("tiny.yaml")
    assert source.check(base) == []
    before = source.content(base)
    assert source.read(base).n_recordings == N
    assert read == [base / "tiny.yaml"]
    (base / "tiny.yaml").write_text(TINY.replace("trials: 2", "trials: 20"), encoding="utf-8")
    assert source.content(base) != before
    assert source.read(base).n_recordings == 10 * N
    assert len(read) == 2


def test_randomised_forces_are_one_more_cell_and_change_no_other_trial(base):
    (base / "random.yaml").write_text(TINY + "randomised_force_n: [0.8, 1.2]\n", encoding="utf-8")
    trials, fixed = SceneTrials("random.yaml").read(base), read(base)
    assert trials.n_recordings == 3 * 2 * 3 * 2
    randomised = trials.columns["randomised_force"] == 1
    assert randomised.sum() == 3 * 2 * 2
    forces = trials.columns["force_n"][randomised]
    assert len(set(forces)) == len(forces)
    assert ((forces >= 0.8) & (forces <= 1.2)).all()
    for k, same in zip(np.flatnonzero(~randomised), range(N), strict=True):
        ours, theirs = trial(trials.scene, int(k)), trial(fixed.scene, same)
        assert (ours.key, ours.force_n) == (theirs.key, theirs.force_n)
    assert all(trial(trials.scene, int(k)).force_n in forces for k in np.flatnonzero(randomised))
    assert SceneTrials("random.yaml").content(base) != SceneTrials("tiny.yaml").content(base)


def test_columns_in_the_order_of_trials(base):
    trials = read(base)
    assert tuple(trials.columns) == COLUMNS == tuple(SceneTrials("tiny.yaml").columns)
    assert trials.n_recordings == N
    assert trials_of(trials) is trials and all(len(values) == N for values in trials.columns.values())
    assert (trials.width, trials.height, trials.duration_us) == (64, 48, 120_000)
    for k in range(N):
        texture, motion, force, repetition = trials.scene.cell(k)
        found = tuple(values[k] for values in trials.columns.values())
        assert found == (
            *(("denim", "foam", "wool")[texture], ("constant_20", "constant_40")[motion], (20, 40)[motion]),
            *((1, 1.5)[force], 0, repetition),
        )


def test_pixels_that_see_pins(base):
    # Pins at 32 and 24 +- 10 px, radius 4 px, a pitch of 20 px around them: cut off by the frame above.
    assert read(base).pins() == (0, 0, 64, 48)
    wide = dataclasses.replace(read(base).scene.sensor, frame_px=(200, 101))
    assert Trials(dataclasses.replace(read(base).scene, sensor=wide)).pins() == (66, 16, 68, 69)


def test_events_are_made_when_asked_for_and_the_same_in_a_smaller_scene(base):
    whole, part = read(base), read(base, textures=("wool",), trials=1)
    assert part.n_recordings == 4
    same = np.flatnonzero((whole.columns["texture"] == "wool") & (whole.columns["repetition"] == 0))
    expected = simulate.events(whole.scene, int(same[3]))
    assert 0 < len(expected.t_us) and 0 <= expected.t_us[0] and expected.t_us[-1] < whole.duration_us
    for (block,) in (whole.blocks(int(same[3])), whole.blocks(int(same[3])), part.blocks(3)):
        for field in dataclasses.fields(block):
            np.testing.assert_array_equal(getattr(block, field.name), getattr(expected, field.name))


def test_overrides(base):
    scene = read(base, textures=("wool", "denim"), trials=5, duration_ms=80.0, seed=9).scene
    assert [texture.name for texture in scene.textures] == ["wool", "denim"]
    assert (scene.trials, scene.duration_ms, scene.seed) == (5, 80.0, 9)
    assert read(base).scene == load_scene(base / "tiny.yaml")
    assert SceneTrials("quickstart").read(base).scene.name == "quickstart"


def test_every_fault_of_the_scene_is_told(base):
    path = base / "tiny.yaml"
    path.write_text(TINY.replace("denim", "denin").replace("trials: 2", "trials: 0"), encoding="utf-8")
    source = SceneTrials("tiny.yaml")
    faults = source.check(base)
    assert [fault.split(": ")[1].removeprefix(f"{path}:") for fault in faults] == ["4", "8"]
    assert faults[0].startswith(f"scene 'tiny.yaml': {path}:4: unknown texture 'denin'; known: ")
    with pytest.raises(RecordingError, match=r"unknown texture 'denin'.*\n.*trials must be >= 1"):
        source.read(base)
    path.write_text(TINY + "randomised_force_n: [1.2, 0.8]\n", encoding="utf-8")
    (fault,) = source.check(base)
    assert f"{path}:10: randomised_force_n must be in increasing order" in fault
    (fault,) = SceneTrials("quikstart").check(base)
    assert fault.startswith(
        "scene 'quikstart': no such file and no shipped scene of this name; known: natural"
    )
    path.write_text(TINY, encoding="utf-8")
    each_once = r"data\.textures must name one texture or more, each once"
    for textures, message in (
        (("denim", "wol"), r"data\.textures: scene 'tiny\.yaml' has no texture 'wol'; .*Did you mean"),
        (("denim", "denim"), each_once),
        ((), each_once),
    ):
        with pytest.raises(RecordingError, match=message):
            read(base, textures=textures)


def test_the_hash_follows_the_numbers_and_nothing_else(base, monkeypatch):
    first = SceneTrials("tiny.yaml").content(base)
    (base / "renamed.yaml").write_text(f"# a comment\n{TINY.replace('scene: tiny', 'scene: x')}", "utf-8")
    assert SceneTrials("renamed.yaml").content(base) == first
    assert SceneTrials("tiny.yaml", trials=2).content(base) == first
    others = {
        SceneTrials("tiny.yaml", **keys).content(base)
        for keys in ({"seed": 1}, {"trials": 3}, {"duration_ms": 80.0}, {"textures": ("denim",)})
    }
    (base / "tiny.yaml").write_text(TINY.replace("kind: constant", "kind: accelerating")
                                    .replace("speed_mm_s", "peak_mm_s"), encoding="utf-8")  # fmt: skip
    others.add(SceneTrials("tiny.yaml").content(base))
    monkeypatch.setattr(simulate, "VERSION", simulate.VERSION + 1)
    others.add(SceneTrials("renamed.yaml").content(base))
    assert len(others) == 6
    assert first not in others
