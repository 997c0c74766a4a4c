import os

import pytest

from dse.data.recordings import RecordingError
from dse.data.recordings.files import locate


def test_beside_the_yaml_wins_over_the_environment_and_that_over_here(tmp_path, monkeypatch):
    folders = [tmp_path / name for name in ("yaml", "environment", "here")]
    for folder in folders:
        folder.mkdir()
        (folder / "x.npz").write_bytes(b"")
    monkeypatch.setenv("DSE_DATA", str(folders[1]))
    monkeypatch.chdir(folders[2])
    for folder in folders:
        assert locate("x.npz", folders[0]) == folder / "x.npz"
        (folder / "x.npz").unlink()
    with pytest.raises(RecordingError) as error:
        locate("x.npz", folders[0])
    assert "data file 'x.npz' not found; looked in" in str(error.value)
    assert all(str(folder) in str(error.value) for folder in folders)
    assert "\n" not in str(error.value)


def test_an_absolute_path_is_taken_as_it_is(tmp_path):
    (tmp_path / "x.npz").write_bytes(b"")
    assert locate(str(tmp_path / "x.npz"), tmp_path / "elsewhere") == tmp_path / "x.npz"
    with pytest.raises(RecordingError, match="not found"):
        locate(str(tmp_path / "y.npz"), tmp_path)


def test_what_is_no_file_is_named_as_such(tmp_path):
    os.mkfifo(tmp_path / "x.npz")
    for kind, name in (("file", "x.npz"), ("folder", "x.npz")):
        with pytest.raises(
            RecordingError, match=rf"data {kind} 'x.npz': .*x.npz must be a {kind}, and is none"
        ):
            locate(name, tmp_path, kind)
