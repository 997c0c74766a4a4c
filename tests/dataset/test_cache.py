import dataclasses
import os

import numpy as np
import pytest

from dse.dataset import dataset_key, load, save
from dse.recordings import RecordingError
from dse.records import Dataset, Spikes

NONE = np.zeros(0, dtype=np.int64)
DATASET = Dataset(
    spikes=Spikes(np.array([0, 1, 1, 3, 3]), np.array([2, 0, 1], dtype=np.int32), 2, 3, 5.0),
    target=np.array([1, 0]), classes=("a", "b"), start=np.array([0, 1], dtype=np.int32),
    start_low=np.array([0, 0], dtype=np.int32), start_high=np.array([1, 1], dtype=np.int32), n_steps=1,
    train=np.array([0]), validation=np.array([1]), test=NONE,
)  # fmt: skip
DESIGN = {
    "data": {"kind": "raster", "file": "x.npz", "step_ms": 5},
    "task": {"name": "letters", "target": "letter"},
    "split": {"stratified": {"validation": 0.2}},
    "window": {"n_steps": 20},
    "model": {"hidden": [100]},
}


def same(a, b):
    for field in dataclasses.fields(a):
        x, y = getattr(a, field.name), getattr(b, field.name)
        if dataclasses.is_dataclass(x):
            same(x, y)
        elif isinstance(x, np.ndarray):
            assert np.array_equal(x, y) and x.dtype == y.dtype, field.name
        else:
            assert x == y, field.name


def test_a_data_set_comes_back_mapped_and_read_only(tmp_path):
    save(DATASET, tmp_path / "cache" / "key")
    found = load(tmp_path / "cache" / "key")
    same(DATASET, found)
    assert isinstance(found.spikes.channel, np.memmap) and not found.spikes.channel.flags.writeable
    assert os.listdir(tmp_path / "cache") == ["key"]


def test_a_folder_that_is_there_is_kept(tmp_path):
    save(DATASET, tmp_path / "key")
    save(dataclasses.replace(DATASET, classes=("c", "d")), tmp_path / "key")
    assert load(tmp_path / "key").classes == ("a", "b")


def test_a_write_that_fails_leaves_nothing(tmp_path, monkeypatch):
    def full(*_):
        raise OSError("No space left on device")

    monkeypatch.setattr(np, "save", full)
    with pytest.raises(OSError, match="No space left"):
        save(DATASET, tmp_path / "key")
    assert os.listdir(tmp_path) == []


def test_the_loser_of_a_race_takes_the_winners_data_set(tmp_path, monkeypatch):
    rename = os.replace

    def late(part, folder):
        rename(part, folder)
        part.mkdir()
        rename(part, folder)  # raises: the folder is there and full

    monkeypatch.setattr(os, "replace", late)
    save(DATASET, tmp_path / "key")
    same(DATASET, load(tmp_path / "key"))
    assert os.listdir(tmp_path) == ["key"]


@pytest.mark.parametrize("damage", ["absent", "no meta", "cut"])
def test_a_damaged_folder_is_named(tmp_path, damage):
    if damage != "absent":
        save(DATASET, tmp_path / "key")
    if damage == "no meta":
        (tmp_path / "key" / "meta.json").unlink()
    if damage == "cut":
        (tmp_path / "key" / "channel.npy").write_bytes(b"\x93NUMPY")
    with pytest.raises(RecordingError, match="key: no readable data set"):
        load(tmp_path / "key")


def test_the_key_follows_content_and_sections_alone(tmp_path):
    for folder, content in (("a", b"one"), ("b", b"one"), ("c", b"two")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "x.npz").write_bytes(content)
    key = dataset_key(DESIGN, tmp_path / "a")
    assert dataset_key(DESIGN, tmp_path / "b") == key != dataset_key(DESIGN, tmp_path / "c")
    assert dataset_key(DESIGN | {"model": {"hidden": [7]}}, tmp_path / "a") == key
    assert dataset_key(DESIGN | {"task": {"name": "x", "target": "letter"}}, tmp_path / "a") == key
    for change in (
        {"task": {"target": "word"}},
        {"window": {"n_steps": 21}},
        {"split": {"stratified": {"validation": 0.3}}},
        {"data": {**DESIGN["data"], "step_ms": 6}},
        {"test": {"file": "x.npz"}},
        {"encoder": {"kind": "e"}},
        {"preprocessing": {"bin_ms": 1}},
    ):
        assert dataset_key(DESIGN | change, tmp_path / "a") != key, change


def test_the_key_sees_a_file_change(tmp_path):
    (tmp_path / "x.npz").write_bytes(b"one")
    key = dataset_key(DESIGN, tmp_path)
    (tmp_path / "x.npz").write_bytes(b"three")
    assert dataset_key(DESIGN, tmp_path) != key
    (tmp_path / "x.npz").unlink()
    with pytest.raises(RecordingError, match="not found"):
        dataset_key(DESIGN, tmp_path)
