"""Runs -> rows: means over repeats, failures, and values that are no numbers."""

import numpy as np
import pandas as pd
import pytest

from dse.config import Axis
from dse.measure.numbers import Numbers
from dse.study import trials
from dse.study.record import RunRecord
from tests import tiny_study


@pytest.fixture
def space(tmp_path):
    model = {"kind": "fake", "hidden": {"choice": [[4], [8, 4]]}, "mood": {"choice": ["fine", "raise"]}}
    yield tiny_study.make_space(tmp_path, model=model)


def record(trial, repeat, accuracy, **changes):
    design = {"model.hidden": [4] if trial == 0 else [8, 4], "model.mood": "fine"}
    if accuracy is None:
        return RunRecord(trial=trial, repeat=repeat, design=design, seed=0, reason="NaN loss")
    columns = {"accuracy": accuracy, "accuracy_se": 0.1, "t_h_ms": None, "n_weights": 28, **changes}
    hardware = {
        "chip": {"energy_uj": 1.0 + repeat, "fits": repeat == 0},
        "other": {"energy_uj": 9.0, "fits": True},
    }
    numbers = Numbers(columns, hardware)
    return RunRecord(trial=trial, repeat=repeat, design=design, seed=0, numbers=numbers)


def test_repeats_are_averaged(space):
    runs = {0: [record(0, 0, 0.5), record(0, 1, 0.75), record(0, 2, 1.0)], 1: [record(1, 0, 0.6)]}
    frame = trials.trials_table(space, runs).set_index("trial")
    assert frame.loc[0, "accuracy"] == 0.75
    assert frame.loc[0, "accuracy_se"] == pytest.approx(0.25 / np.sqrt(3))
    assert frame.loc[1, "accuracy_se"] == 0.1
    assert frame.loc[0, "energy_uj"] == 2.0
    assert list(frame["fits"]) == [False, True]
    assert list(frame["repeats"]) == [3, 1]
    assert list(frame["hardware"]) == ["chip", "chip"]
    assert frame["n_weights"].dtype == np.int64
    assert frame["t_h_ms"].isna().all()


def test_reaction_times_on_the_test_set_have_a_range_over_folds(space):
    times = {0: (30.0, None), 1: (10.0, 5.0), 2: (20.0, 7.0)}
    runs = [record(0, r, 0.5, t_p_test_ms=p, t_h_test_ms=h) for r, (p, h) in times.items()]
    row = trials.trials_table(space, {0: runs}).loc[0]
    assert tuple(row[["t_p_test_ms", "t_p_test_ms_min", "t_p_test_ms_max"]]) == (20.0, 10.0, 30.0)
    assert row[["t_h_test_ms", "t_h_test_ms_min", "t_h_test_ms_max"]].isna().all(), "a fold never gets there"
    assert not [name for name in row.index if name.startswith("accuracy_m")]
    assert "t_p_test_ms_min" not in trials.trials_table(space, {0: runs[:1]})


def test_what_one_of_several_runs_does_not_measure_is_missing(space):
    silent = record(0, 1, 0.5)
    runs = [record(0, 0, 0.5, first_spike_ms=4.0), silent, record(0, 2, 0.5, dead_neurons=1)]
    for order in (runs, runs[::-1]):
        frame = trials.trials_table(space, {0: order})
        assert frame.loc[0, "accuracy"] == 0.5
        assert frame[["first_spike_ms", "dead_neurons"]].isna().all(axis=None)


def test_a_list_is_text_in_a_table(space, tmp_path):
    frame = trials.trials_table(space, {0: [record(0, 0, 0.5)], 1: [record(1, 0, 0.5)]})
    assert list(frame["model.hidden"]) == ["[4]", "[8, 4]"]
    frame.to_parquet(tmp_path / "x.parquet")
    assert pd.read_parquet(tmp_path / "x.parquet")["model.hidden"].tolist() == ["[4]", "[8, 4]"]


def test_whole_numbers_in_lists_are_written_as_people_do():
    axis = Axis("encoder.thresholds", values=((1.0, 2.5), (2.0,)))
    assert axis.cell((1.0, 2.5)) == "[1, 2.5]"


def test_one_failed_repeat_fails_the_trial(space, tmp_path):
    runs = {0: [record(0, 0, None)], 1: [record(1, 0, 0.5), record(1, 1, None)], 2: [record(1, 0, 0.5)]}
    frame = trials.trials_table(space, runs)
    assert list(frame["status"]) == ["failed", "failed", "finished"]
    assert list(frame["reason"]) == ["NaN loss", "repeat 1: NaN loss", ""]
    assert frame["accuracy"].isna().tolist() == [True, True, False]
    assert list(frame.columns[-2:]) == ["status", "reason"]
    assert frame["fits"].isna().tolist() == [True, True, False]
    frame.to_parquet(tmp_path / "x.parquet")


def test_the_task_of_an_axis_of_targets_is_its_columns(tmp_path):
    task = {"target": {"choice": ["fabric", ["fabric", {"column": "speed", "abs": True}]]}}
    data = {**tiny_study.plain()["data"], "columns": {"fabric": "label", "speed": "label"}}
    space = tiny_study.make_space(tmp_path, task=task, data=data)
    names = [space.task_name({"task.target": target}) for target in space.axes["task.target"].values or ()]
    assert names == ["fabric", "fabric|speed"]
    assert len(trials.trials_table(space, {})) == 0
