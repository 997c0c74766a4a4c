import errno
import os
import zipfile
from pathlib import Path

import numpy as np
import pytest

from dse.recordings import RecordingError
from dse.recordings.events import EventFile, event_archive
from dse.records import Block

ADDRESSES = ("t_us", "x", "y", "polarity")


def block(*events):
    t_us, x, y, polarity = np.array(events, dtype=np.int64).reshape(-1, 4).T
    return Block(t_us, x.astype(np.int32), y.astype(np.int32), polarity.astype(np.uint8))


BLOCKS = (
    block((0, 0, 0, 1), (70_000, 299, 199, 0), (100_000, 7, 8, 1)),
    block((3, 5, 6, 1)),
    block((5, 1, 2, 0), (5, 1, 3, 1)),
)
COLUMNS = {"texture": np.array(["denim", "wool", "wool"]), "force_n": np.array([0.8, 1.0, 1.2])}


def write(path, blocks=BLOCKS, columns=COLUMNS):
    with event_archive(path, 300, 200, 100_000, columns) as append:
        for each in blocks:
            append(each)


def read(path):
    names = {"file": str(path), "x": "x", "y": "y", "polarity": "polarity"}
    source = EventFile(width=300, height=200, columns={name: name for name in COLUMNS}, **names)
    return source.read(path.parent)


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    write(tmp_path / "touch.npz")
    assert [file.name for file in tmp_path.iterdir()] == ["touch.npz"]
    restored = read(tmp_path / "touch.npz")
    assert restored.n_recordings == 3
    for i, given in enumerate(BLOCKS):
        (one,) = restored.blocks(i)
        for name in ADDRESSES:
            assert getattr(one, name).tolist() == getattr(given, name).tolist()
    assert restored.columns["texture"].tolist() == ["denim", "wool", "wool"]
    assert restored.columns["force_n"].tolist() == [0.8, 1.0, 1.2]


def test_numpy_reads_it_and_arrays_are_as_small_as_their_range(tmp_path: Path) -> None:
    write(tmp_path / "touch.npz")
    with np.load(tmp_path / "touch.npz", allow_pickle=False) as arrays:
        assert {name: str(arrays[name].dtype) for name in ADDRESSES} == {
            "t_us": "uint32",
            "x": "uint16",
            "y": "uint8",
            "polarity": "uint8",
        }
        assert (int(arrays["width"]), int(arrays["height"])) == (300, 200)
        assert arrays["offsets"].tolist() == [0, 3, 4, 6]


def test_same_recordings_same_bytes(tmp_path: Path) -> None:
    write(tmp_path / "a.npz")
    write(tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    with zipfile.ZipFile(tmp_path / "a.npz") as archive:
        assert archive.testzip() is None


def test_recordings_without_events_keep_their_place(tmp_path: Path) -> None:
    write(tmp_path / "touch.npz", [block(), BLOCKS[0], block()])
    with np.load(tmp_path / "touch.npz", allow_pickle=False) as arrays:
        assert arrays["offsets"].tolist() == [0, 0, 3, 3]
        assert arrays["t_us"].tolist() == [0, 70_000, 100_000]


def test_a_failure_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "touch.npz"
    write(path)
    before = path.read_bytes()

    def broken():
        yield BLOCKS[0]
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write(path, broken())
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["touch.npz"]


def test_labels_must_be_one_per_recording(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"'texture' must have one value for each of the 2 rec.*, got 3"):
        write(tmp_path / "touch.npz", BLOCKS[:2])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("when", ["fsync", "replace"])
def test_a_disk_that_refuses_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, when: str
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, when, full)
    with pytest.raises(RecordingError, match="cannot be written: No space left on device; no partial file"):
        write(tmp_path / "touch.npz")
    assert list(tmp_path.iterdir()) == []
