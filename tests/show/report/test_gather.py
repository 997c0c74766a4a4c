"""What a report says of its studies, from numbers that are chosen."""

import pandas as pd
import pytest

from dse import store
from dse.show.report.designs import tasks_of
from dse.show.report.gather import report
from tests.show.report.made import noted, write


def test_a_study_whose_designs_all_failed_has_its_reason(tmp_path):
    found = report([write(tmp_path / "bad", [], failed=3)])
    assert found.rows == []
    assert noted(found, "bad: 3 of 3 designs failed; the first: ValueError: hidden must be kind")


def test_warnings_are_passed_on(tmp_path):
    written = write(tmp_path / "traps", [{"accuracy": 0.9}])
    told = ["labels are given away", "level 0.9 of 7", "level 0.8 of 7", "level 0.91 of 12"]
    store.keep(written.folder, store.WARNINGS, told)
    found = [note for note in report([written]).notes if "warning" in note]
    assert found == [
        "traps: warning: labels are given away",
        "traps: warning: level 0.9 of 7 (and 2 of the kind)",
    ]


def test_what_is_damaged_is_one_line(tmp_path):
    written = write(tmp_path / "damaged", [{"accuracy": 0.9}])
    store.run_file(written.folder, 0, 0).write_bytes(b"no run")
    with pytest.raises(store.StoreError, match=r"00000-0\.npz: cannot be read"):
        report([written])


@pytest.mark.parametrize(
    ("split", "told"),
    [
        (
            {"stratified": {"validation": 0.5, "group": None, "seed": 1}},
            "stratified: validation 0.5, test 0.0 (train 20, validation 10)",
        ),
        (
            {"k_fold": {"k": 10, "group": None, "test": {"repetition": 1}, "seed": 1, "fold": 3}},
            "k-fold: k 10, test repetition 1 (train 20, validation 10)",
        ),
        ({"train": {"a": [0, 1, 2, 3, 4, 5]}, "validation": {"a": [6]}}, "train: a 0 to 5; validation: a 6"),
        ({"train": {"a": ["x", "y", "z", "u", "v"]}, "validation": {"a": "w"}}, 'train: a "x", "y", "z"'),
    ],
)
def test_splits_in_words(tmp_path, split, told):
    [part] = tasks_of(write(tmp_path / "s", [{"accuracy": 0.9}], {"split": split}))
    assert part.split.startswith(told)


def test_nothing_is_changed(tmp_path):
    assert report([]).rows == []
    written = write(tmp_path / "kept", [{"accuracy": 0.9}])
    before = {path: path.stat().st_mtime_ns for path in written.folder.rglob("*")}
    table = written.points()
    report([written])
    assert before == {path: path.stat().st_mtime_ns for path in written.folder.rglob("*")}
    pd.testing.assert_frame_equal(written.points(), table)
