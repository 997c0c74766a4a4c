"""A training run on disk: complete, or its damage is named."""

import os
import resource

import numpy as np
import pytest

from dse import store


def _save(folder, **changes):
    record = {
        "trial": 1,
        "repeat": 0,
        "columns": {"accuracy": np.float64(0.5), "fits": np.bool_(True)},
        **changes,
    }
    store.save_run(folder, record, {"a.npz": {"x": np.arange(3)}})


def test_a_run_comes_back_with_its_checksums(tmp_path):
    folder = store.run_file(tmp_path, 1, 0)
    assert store.load_run(folder) is None
    _save(folder)
    record = store.load_run(folder)
    assert record["columns"] == {"accuracy": 0.5, "fits": True}
    assert list(record["files"]) == ["a.npz"]
    assert store.load_arrays(folder / "a.npz")["x"].tolist() == [0, 1, 2]


def test_the_first_run_of_a_search_that_was_stopped_need_not_be_repeat_0(tmp_path):
    assert store.first_run(tmp_path, 1) == store.run_file(tmp_path, 1, 0)
    for repeat in (3, 2):
        _save(store.run_file(tmp_path, 1, repeat), repeat=repeat)
    assert store.first_run(tmp_path, 1) == store.run_file(tmp_path, 1, 2)


def _truncate(path):
    path.write_bytes(path.read_bytes()[:-9])


def _flip(path):
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


@pytest.mark.parametrize("is_noted", [False, True])
@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (_truncate, "cannot be read"),
        (_flip, "is damaged|cannot be read|is not what was written"),
        (lambda path: (path.unlink(), os.mkfifo(path)), "is not a file"),
        (lambda path: path.write_text("[]"), "cannot be read"),
    ],
)
def test_damage_is_named(tmp_path, damage, message, is_noted):
    run = store.run_file(tmp_path, 1, 0)
    _save(run)
    if is_noted:
        with store.Book(tmp_path, writes=True) as book:
            store.note_files(book, [run])
    damage(run)
    with pytest.raises(store.Damaged, match=f"{run.name}: ({message}).*; `dse doctor RESULTS` says"):
        store.load_run(run)


def test_another_run_in_its_place_is_not_what_was_written(tmp_path):
    run = store.run_file(tmp_path, 1, 0)
    _save(run)
    with store.Book(tmp_path, writes=True) as book:
        store.note_files(book, [run])
    _save(run, columns={"accuracy": 0.6})
    assert store.read_record(run)["columns"]["accuracy"] == 0.5, "a finished run is never replaced"
    run.unlink()
    _save(run, columns={"accuracy": 0.6})
    with pytest.raises(store.Damaged, match="is not what was written"):
        store.load_run(run)


def test_a_record_of_a_newer_schema_is_refused(tmp_path):
    folder = store.run_file(tmp_path, 1, 0)
    _save(folder, schema=store.SCHEMA + 1)
    with pytest.raises(store.StoreError, match="is newer than"):
        store.load_run(folder)


def test_a_run_in_the_place_of_another_is_refused(tmp_path):
    _save(store.run_file(tmp_path, 1, 0))
    other = store.run_file(tmp_path, 3, 0)
    store.run_file(tmp_path, 1, 0).rename(other)
    with pytest.raises(store.Damaged, match="is trial 1 repeat 0"):
        store.load_run(other)


def test_a_process_without_file_descriptors_finds_no_damage(tmp_path):
    folder = store.run_file(tmp_path, 1, 0)
    _save(folder)
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (0, hard))
    try:
        with pytest.raises(store.StoreError, match="cannot be read: Too many open files") as refused:
            store.load_run(folder)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    assert not isinstance(refused.value, store.Damaged)
