"""What `dse check` says of recordings that are simulated, or that stay in their files."""

import numpy as np
import pytest
import yaml

from dse.config import load_space
from dse.data.recordings import RecordingError
from dse.data.recordings.event_files import FolderEvents
from dse.data.recordings.scene import Trials
from dse.scene import simulate
from dse.scene.load import load_scene
from dse.study.preview import preview
from tests.spaces import FINGERTIP

SCENE = FINGERTIP + "forces_n: [1.0, 1.5]\ntrials: 5\n"
SPACE = {
    "study": "events",
    "data": {"kind": "scene", "scene": "fingertip.yaml"},
    "task": {"target": {"choice": ["texture", ["texture", "profile"]]}},
    "split": {"stratified": {"validation": 0.2}},
    "preprocessing": {"bin_ms": 5, "pool": {"choice": [4, 8]}},
    "model": {"kind": "snn", "hidden": {"choice": [[10], [20]]}},
    "objectives": ["accuracy:max"],
}


def shown(folder, **changes):
    path = folder / "space.yaml"
    path.write_text(yaml.safe_dump({**SPACE, **changes}), encoding="utf-8")
    return preview(load_space(path, check_data=True))


@pytest.fixture
def scene(tmp_path, monkeypatch):
    """A folder with a scene that nobody may simulate."""

    def never(*_):
        raise AssertionError("a preview simulates nothing")

    for name in ("events", "simulated"):
        monkeypatch.setattr(simulate, name, never)
    (tmp_path / "fingertip.yaml").write_text(SCENE, encoding="utf-8")
    return tmp_path


def test_a_scene_is_counted_and_not_simulated(scene):
    row = shown(scene)
    assert row["data"] == "fingertip.yaml"
    assert (row["recordings"], row["train"], row["validation"], row["test"]) == (40, 32, 8, 0)
    assert row["classes"] == ["denim", "satin"]
    assert row["designs"] == 8
    # Pools of 8 and of 4 pixels in 96 x 64, ON and OFF; texture alone, and with two profiles.
    assert (row["n_weights_low"], row["n_weights_high"]) == (10 * (2 * 96 + 2), 20 * (2 * 384 + 4))


def test_a_joint_net_has_an_output_per_class_of_each_head(scene):
    task = {"target": ["texture", "profile", "force_n"], "joint": True}
    row = shown(scene, task=task, model={"kind": "snn", "hidden": 10}, preprocessing={"bin_ms": 5, "pool": 8})
    assert len(row["classes"]) == 8
    assert row["n_weights_low"] == 10 * (2 * 96 + 2 + 2 + 2)


def test_a_scene_knows_where_its_pins_are(scene):
    row = shown(scene, preprocessing={"bin_ms": 5, "pool": 1, "crop": "pins", "polarity": "merge"})
    width, height = Trials(load_scene(str(scene / "fingertip.yaml"))).pins()[2:]
    assert width < 96
    assert row["n_weights_low"] == 10 * (width * height + 2)


def test_a_recording_without_events_is_refused_where_a_split_has_it(tmp_path):
    zeros = np.zeros(5, np.int32)
    arrays = {"t_us": 1000 * np.arange(5), "taxel": zeros, "offsets": np.array([0, 1, 2, 2, 3, 5])}
    labels = {"cloth": np.array(["felt", "silk", "felt", "felt", "silk"]), "part": np.array([0, 0, 2, 1, 1])}
    np.savez(tmp_path / "x.npz", **arrays, **labels)
    columns = {name: name for name in labels}
    data = {"kind": "events", "file": "x.npz", "width": 4, "taxel": "taxel", "columns": columns}
    design = {"data": data, "task": {"target": "cloth"}, "preprocessing": {"bin_ms": 1}}
    split = {"train": {"part": [0]}, "validation": {"part": [1]}}
    row = shown(tmp_path, **design, split=split)
    assert (row["recordings"], row["train"], row["validation"]) == (5, 2, 2)
    with pytest.raises(RecordingError, match=r"^recording 2 must have events, got none$"):
        shown(tmp_path, **design, split={**split, "test": {"part": [2]}})


def test_event_files_are_counted_and_not_read(tmp_path, monkeypatch):
    rng = np.random.default_rng(0)
    for cloth in ("felt", "silk"):
        (tmp_path / "files" / cloth).mkdir(parents=True)
        for i in range(5):
            arrays = {"t": np.sort(rng.integers(0, 1000, 20)), "x": rng.integers(0, 16, 20)}
            np.savez(tmp_path / "files" / cloth / f"{i}.npz", **arrays, y=arrays["x"], p=arrays["x"] % 2)

    def never(*_):
        raise AssertionError("a preview reads no events")

    monkeypatch.setattr(FolderEvents, "blocks", never)
    columns = {"cloth": "folder"}
    data = {
        "kind": "event_files",
        "folder": "files",
        "label_from": "folder",
        "width": 16,
        "height": 16,
        "columns": columns,
    }
    row = shown(tmp_path, data=data, task={"target": "cloth"})
    assert row["data"] == str(tmp_path / "files")
    assert (row["recordings"], row["train"], row["validation"]) == (10, 8, 2)
    assert row["classes"] == ["felt", "silk"]
    assert (row["n_weights_low"], row["n_weights_high"]) == (10 * (2 * 4 + 2), 20 * (2 * 16 + 2))
    fitted = {**SPACE["preprocessing"], "crop": "pins"}
    row = shown(tmp_path, data=data, task={"target": "cloth"}, preprocessing=fitted)
    assert row["classes"] == ["felt", "silk"]
    assert "n_weights_low" not in row, "the crop follows from the events"
