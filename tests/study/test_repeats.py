"""Numbers of one run of each design: the last, or the worst; the same for the command line and the page."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest
import yaml

import dse
from dse.cli.command_line import main
from dse.dashboard.study import PageRequest, write_page
from dse.skyline.constraints import ExpressionError
from dse.store import StoreError, run_file
from dse.study.question import Question
from dse.study.record import load_record
from dse.study.repeats import over_repeats
from tests.page_data import held
from tests.tiny_study import REAL, write_recordings


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """A small study whose designs were trained twice."""
    folder = tmp_path_factory.mktemp("repeated")
    write_recordings(folder / "tiny.npz")
    space = yaml.safe_load(REAL)
    space["data"]["file"] = str(folder / "tiny.npz")
    return dse.run(space, folder, jobs=1, progress=False)


def test_every_number_is_of_the_chosen_run_and_points_stay(study):
    mean, last, worst = (study.points(repeats=how) for how in ("mean", "last", "worst"))
    identity = ["trial", "point", "phi", "theta", "read_out_ms", "hardware"]
    for table in (last, worst):
        pd.testing.assert_frame_equal(table[identity], mean[identity])
        assert list(table.columns) == list(mean.columns)
        assert np.isfinite(table["energy_uj"]).all()
    runs = [load_record(run_file(study.folder, 0, repeat)).measured.columns for repeat in (0, 1)]
    first, second = (run["accuracy"] for run in runs)
    assert mean["accuracy"][0] == pytest.approx((first + second) / 2)
    assert last["accuracy"][0] == second
    assert worst["accuracy"][0] == min(first, second)
    assert worst["spikes_total"][0] == runs[int(second < first)]["spikes_total"]
    assert (mean["energy_uj"] != last["energy_uj"]).any()
    assert mean["accuracy_corrected"].notna().all() and last["accuracy_corrected"].isna().all()


def test_door_command_line_and_page_agree(study, capsys, tmp_path):
    front = study.skyline(repeats="worst").rows
    assert main(["skyline", str(study.folder), "--repeats", "worst", "--format", "csv"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == len(front) + 1
    path = write_page(study, tmp_path / "page.html", PageRequest(question=Question(repeats="worst")))
    page = held(path)
    assert page["columns"]["accuracy"]["values"] == pytest.approx(study.points(repeats="worst")["accuracy"])
    assert page["budgets"]["repeats"] == "worst"
    assert any("run of least accuracy alone" in note for note in page["notes"])
    assert main(["pick", str(study.folder), "--repeats", "worst", "--json"]) == 0
    picked = json.loads(capsys.readouterr().out)
    assert picked["rows"][0]["accuracy_corrected"] is None
    assert "no accuracy_corrected: measured elsewhere, or one run of several" in picked["notes"]
    best = study.pick(repeats="worst").row
    assert best["accuracy"] == study.points(repeats="worst")["accuracy"].max()


def test_what_one_run_cannot_tell_is_refused(study, tmp_path):
    with pytest.raises(ExpressionError, match="repeats last is one run of each design"):
        study.skyline(repeats="last", confidence=0.5)
    with pytest.raises(ExpressionError, match="repeats last is one run of each design"):
        study.pick(repeats="last", confidence=0.5)
    with pytest.raises(StoreError, match="--draws samples all runs"):
        write_page(study, tmp_path / "page.html", PageRequest(question=Question(draws=5, repeats="last")))
    with pytest.raises(TypeError, match="best"):
        study.skyline(repeats="best")
    with pytest.raises(StoreError, match="repeats must be one of"):
        over_repeats(tmp_path, pd.DataFrame({"trial": [0]}), "best")
