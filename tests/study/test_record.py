"""The record of a run: plain data and back."""

from pathlib import Path

import pandas as pd
import pytest

from dse.store import Damaged, StoreError, run_file
from dse.study import held
from dse.study.record import RunRecord

MEASURED = {
    "columns": {"accuracy": 0.5, "transductive": False},
    "hardware": {"chip": {"energy_uj": 1.5, "fits": True}},
}
FINISHED = {
    "trial": 3,
    "repeat": 1,
    "design": {"model.hidden": [4, 2]},
    "seed": 7,
    "sections": {"model": {"kind": "snn"}},
    "classes": ["a|x", "a|y", "b|x"],
    "heads": {
        "letter": {"classes": ["a", "b"], "of_class": [0, 0, 1]},
        "other": {"classes": ["x", "y"], "of_class": [0, 1, 0]},
    },
    "data": "0123",
    "samples": {"train": 4, "validation": 2, "test": 0},
    "transductive": "",
    "status": "finished",
    "reason": "",
    **MEASURED,
    "of_heads": {"letter": MEASURED, "other": MEASURED},
}
FAILED = {
    "trial": 3,
    "repeat": 0,
    "design": {},
    "seed": 7,
    "status": "failed",
    "reason": "ValueError: no",
    "details": "Traceback",
}


@pytest.mark.parametrize("plain", [FINISHED, FAILED, {**FAILED, "needs_bytes": 12}])
def test_a_record_survives(plain):
    record = RunRecord.from_plain({**plain, "files": {"weights.npz": "sum"}}, Path("record.json"))
    assert record.to_plain() == plain
    assert record.files == ("weights.npz",)
    assert record.failed is (plain["status"] == "failed")


def test_what_a_run_measured():
    record = RunRecord.from_plain(FINISHED, Path("record.json"))
    assert record.measured.of_head("letter").columns["accuracy"] == 0.5
    assert record.measured.of_head("") is record.measured
    assert [head.name for head in record.heads] == ["letter", "other"]
    with pytest.raises(ValueError, match="trial 3 failed: ValueError: no"):
        _ = RunRecord.from_plain(FAILED, Path("record.json")).measured


@pytest.mark.parametrize("key", ["trial", "design", "status", "columns", "hardware"])
def test_a_key_that_is_missing_is_named(key):
    plain = {name: value for name, value in FINISHED.items() if name != key}
    with pytest.raises(StoreError, match=rf"run/record.json: key '{key}' is missing or invalid"):
        RunRecord.from_plain(plain, Path("run/record.json"))


@pytest.mark.parametrize(
    ("key", "value"),
    [("design", None), ("sections", []), ("seed", "7"), ("data", 3), ("hardware", 1), ("unseen", [])],
)
def test_a_key_of_another_type_is_damage(key, value):
    with pytest.raises(Damaged, match=rf"record.json: key '?'{key}'?' is missing or invalid; `dse doctor"):
        RunRecord.from_plain({**FINISHED, key: value}, Path("run/record.json"))


def test_values_that_an_earlier_version_was_told_are_left_out(tmp_path):
    told = {"trial": 3, "repeat": 0, "design": {}, "seed": 7, "status": "told", "reason": "", **MEASURED}
    with pytest.raises(Damaged, match="`dse tell`, which are no longer read"):
        RunRecord.from_plain({**told, "of_heads": {}}, Path("run/record.json"))
    for run in (run_file(tmp_path, trial, 0) for trial in (2, 3)):
        run.parent.mkdir(exist_ok=True)
        run.touch()
    table = pd.DataFrame({"trial": [2, 3], "repeats": [1, 1], "origin": [None, "told"]})
    assert held.without_lost(tmp_path, table)["trial"].tolist() == [2]


def test_a_number_that_is_a_list_is_damage():
    columns = {**FINISHED["columns"], "accuracy": [0.5]}
    with pytest.raises(Damaged, match="'accuracy'"):
        RunRecord.from_plain({**FINISHED, "columns": columns}, Path("run/record.json"))
