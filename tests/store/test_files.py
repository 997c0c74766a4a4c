"""Files that are whole or absent."""

import errno
import os
import subprocess
import sys

import numpy as np
import pytest

from dse import store
from dse.store import files


def test_a_file_appears_whole_or_not_at_all(tmp_path):
    path = tmp_path / "a" / "table.txt"
    store.write_text(path, "old")
    with pytest.raises(RuntimeError), store.published(path) as temporary:
        temporary.write_text("ne")
        assert path.read_text() == "old"
        raise RuntimeError
    assert path.read_text() == "old"
    store.write_text(path, "new")
    assert path.read_text() == "new"
    assert [x.name for x in path.parent.iterdir()] == ["table.txt"]


def test_a_published_folder_is_never_replaced(tmp_path):
    folder = tmp_path / "repeat_0"
    for text in ("first", "second"):
        with store.published(folder) as temporary:
            temporary.mkdir()
            (temporary / "x").write_text(text)
    assert (folder / "x").read_text() == "first"
    assert [x.name for x in tmp_path.iterdir()] == ["repeat_0"]


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EROFS])
def test_a_disk_that_refuses_is_one_line(tmp_path, monkeypatch, code):
    def refuse(descriptor):
        raise OSError(code, os.strerror(code))

    store.write_text(tmp_path / "kept", "old")
    monkeypatch.setattr(files.os, "fsync", refuse)
    with pytest.raises(store.StoreError) as caught:
        store.write_text(tmp_path / "kept", "new")
    message = str(caught.value)
    assert message.startswith(f"{tmp_path / 'kept'}: cannot be written: {os.strerror(code)}")
    assert ("free some space" in message) == (code == errno.ENOSPC)
    assert "\n" not in message
    assert [(x.name, x.read_text()) for x in tmp_path.iterdir()] == [("kept", "old")]


def test_a_folder_that_tables_cannot_name_is_refused_first(tmp_path):
    folder = tmp_path / os.fsdecode(b"r\xff")
    with pytest.raises(store.StoreError, match="must have a name in UTF-8"), store.exclusive(folder):
        pass
    assert not folder.exists()


def test_only_one_process_holds_a_study(tmp_path):
    code = "import pathlib, sys; from dse import store\nwith store.exclusive(pathlib.Path(sys.argv[1])): pass"
    command = [sys.executable, "-c", code, str(tmp_path)]
    with store.exclusive(tmp_path):
        refused = subprocess.run(command, capture_output=True, text=True, check=False)
        with pytest.raises(store.StoreError, match="another process"), store.exclusive(tmp_path):
            pass
    assert "another process is running this study" in refused.stderr
    assert subprocess.run(command, check=False).returncode == 0


def test_sweeping_removes_only_what_was_never_finished(tmp_path):
    store.save_run(store.run_file(tmp_path, 0, 0), {"trial": 0}, {})
    left = [tmp_path / ".writing-points.parquet-12", tmp_path / "runs" / ".writing-00000-1.npz-12"]
    for path in left:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("half")
    store.sweep(tmp_path)
    assert sorted(x.name for x in tmp_path.rglob("*") if x.is_file()) == ["00000-0.npz"]


def test_json_that_is_nested_without_end_is_damaged(tmp_path):
    path = tmp_path / "record.json"
    path.write_text("[" * 100_000)
    with pytest.raises(store.StoreError, match="cannot be read"):
        store.read_json(path)


def test_json_refuses_what_it_cannot_hold(tmp_path):
    store.write_json(tmp_path / "x.json", {"a": np.arange(2), "b": (1, 2)})
    assert store.read_json(tmp_path / "x.json") == {"a": [0, 1], "b": [1, 2]}
    with pytest.raises(TypeError, match="object cannot be written as JSON"):
        store.write_json(tmp_path / "y.json", object())
    assert not (tmp_path / "y.json").exists()


def test_a_pipe_in_the_place_of_a_lock_is_held_by_nobody(tmp_path):
    os.mkfifo(tmp_path / ".lock")
    assert not store.is_held(tmp_path)
