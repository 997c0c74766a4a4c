import errno
import os

import numpy as np
import pytest

from dse.data.recordings import RecordingError
from dse.data.recordings.events import EventFile, event_archive
from tests.data.recordings.formats.reading import block, tuples

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


def test_what_is_written_is_read_back_in_arrays_as_small_as_their_range(tmp_path):
    for path in (tmp_path / "a.npz", tmp_path / "b.npz"):
        write(path)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.npz", "b.npz"]
    assert path.read_bytes() == (tmp_path / "a.npz").read_bytes()
    names = {"x": "x", "y": "y", "polarity": "polarity"}
    columns = {name: name for name in COLUMNS}
    restored = EventFile(str(path), width=300, height=200, columns=columns, **names).read(tmp_path)
    assert [tuples(one) for i in range(3) for one in restored.blocks(i)] == [tuples(one) for one in BLOCKS]
    assert {name: values.tolist() for name, values in restored.columns.items()} == {
        name: values.tolist() for name, values in COLUMNS.items()
    }
    with np.load(path, allow_pickle=False) as arrays:
        types = {name: str(arrays[name].dtype) for name in ("t_us", "x", "y", "polarity")}
        assert types == {"t_us": "uint32", "x": "uint16", "y": "uint8", "polarity": "uint8"}
        assert (int(arrays["width"]), int(arrays["height"])) == (300, 200)
        assert arrays["offsets"].tolist() == [0, 3, 4, 6]
    write(path, [block(), BLOCKS[0], block()])
    assert np.load(path)["offsets"].tolist() == [0, 0, 3, 3], "recordings without events keep their place"
    with pytest.raises(RecordingError, match=r"'texture' must have one value for each of the 2 rec.*, got 3"):
        write(tmp_path / "c.npz", BLOCKS[:2])
    assert not (tmp_path / "c.npz").exists()


def test_a_failure_leaves_the_old_file_and_nothing_else(tmp_path):
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


@pytest.mark.parametrize("when", ["fsync", "replace"])
def test_a_disk_that_refuses_is_one_sentence(tmp_path, monkeypatch, when):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, when, full)
    with pytest.raises(RecordingError, match="cannot be written: No space left on device; no partial file"):
        write(tmp_path / "touch.npz")
    assert list(tmp_path.iterdir()) == []
