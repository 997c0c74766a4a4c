"""Runs -> rows: means over repeats, failures, and values that are no numbers."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from dse import store, tables
from dse.config import Axis, SearchSpace
from tests import tiny_study


@pytest.fixture
def space(tmp_path: Path) -> Iterator[SearchSpace]:
    model = {"kind": "fake", "hidden": {"choice": [[4], [8, 4]]}, "mood": {"choice": ["fine", "raise"]}}
    yield tiny_study.make_space(tmp_path, model=model)
    tiny_study.unregister()


def record(trial: int, repeat: int, accuracy: float | None, **changes: Any) -> dict[str, Any]:
    design = {"model.hidden": [4] if trial == 0 else [8, 4], "model.mood": "fine"}
    if accuracy is None:
        return {"trial": trial, "repeat": repeat, "design": design, "status": "failed", "reason": "NaN loss"}
    columns = {"accuracy": accuracy, "accuracy_se": 0.1, "t_h_ms": None, "n_weights": 28, **changes}
    hardware = {
        "chip": {"energy_uj": 1.0 + repeat, "fits": repeat == 0},
        "other": {"energy_uj": 9.0, "fits": True},
    }
    return {
        **{"trial": trial, "repeat": repeat, "design": design, "status": "finished", "reason": ""},
        **{"columns": columns, "hardware": hardware, "files": {}},
    }


def test_repeats_are_averaged(space: SearchSpace) -> None:
    runs = {0: [record(0, 0, 0.5), record(0, 1, 0.75), record(0, 2, 1.0)], 1: [record(1, 0, 0.6)]}
    frame = tables.trials_table(space, runs).set_index("trial")
    assert frame.loc[0, "accuracy"] == 0.75
    assert frame.loc[0, "accuracy_se"] == pytest.approx(0.25 / np.sqrt(3))
    assert frame.loc[1, "accuracy_se"] == 0.1
    assert frame.loc[0, "energy_uj"] == 2.0
    assert list(frame["fits"]) == [False, True]
    assert list(frame["repeats"]) == [3, 1]
    assert list(frame["hardware"]) == ["chip", "chip"]
    assert frame["n_weights"].dtype == np.int64
    assert frame["t_h_ms"].isna().all()


def test_what_one_of_several_runs_does_not_measure_is_missing(space: SearchSpace) -> None:
    silent = record(0, 1, 0.5)
    runs = [record(0, 0, 0.5, first_spike_ms=4.0), silent, record(0, 2, 0.5, dead_neurons=1)]
    for order in (runs, runs[::-1]):
        frame = tables.trials_table(space, {0: order})
        assert frame.loc[0, "accuracy"] == 0.5
        assert frame[["first_spike_ms", "dead_neurons"]].isna().all(axis=None)


def test_objectives_that_no_run_measures_are_columns_of_points(space: SearchSpace, tmp_path: Path) -> None:
    searched = dataclasses.replace(space, objectives=(("accuracy", "max"), ("energy_uj", "min")))
    run = record(0, 0, 0.5) | {"hardware": {"chip": {}}}
    points = tables.points_table(searched, tmp_path, {0: [run]})
    assert points["energy_uj"].isna().all() and list(points["hardware"]) == ["chip"]
    assert tables.points_table(searched, tmp_path, {}).empty


def test_a_list_is_text_in_a_table(space: SearchSpace, tmp_path: Path) -> None:
    frame = tables.trials_table(space, {0: [record(0, 0, 0.5)], 1: [record(1, 0, 0.5)]})
    assert list(frame["model.hidden"]) == ["[4]", "[8, 4]"]
    frame.to_parquet(tmp_path / "x.parquet")
    assert pd.read_parquet(tmp_path / "x.parquet")["model.hidden"].tolist() == ["[4]", "[8, 4]"]


def test_whole_numbers_in_lists_are_written_as_people_do() -> None:
    axis = Axis("encoder.thresholds", values=((1.0, 2.5), (2.0,)))
    assert tables._cell(axis, (1.0, 2.5)) == "[1, 2.5]"


def test_one_failed_repeat_fails_the_trial(space: SearchSpace, tmp_path: Path) -> None:
    runs = {0: [record(0, 0, None)], 1: [record(1, 0, 0.5), record(1, 1, None)], 2: [record(1, 0, 0.5)]}
    frame = tables.trials_table(space, runs)
    assert list(frame["status"]) == ["failed", "failed", "finished"]
    assert list(frame["reason"]) == ["NaN loss", "repeat 1: NaN loss", ""]
    assert frame["accuracy"].isna().tolist() == [True, True, False]
    assert list(frame.columns[-2:]) == ["status", "reason"]
    assert frame["fits"].isna().tolist() == [True, True, False]
    frame.to_parquet(tmp_path / "x.parquet")
    assert list(tables.points_table(space, tmp_path, runs)["trial"]) == [2, 2]


def test_without_a_grid_points_are_full_read_outs_on_every_chip(space: SearchSpace, tmp_path: Path) -> None:
    frame = tables.points_table(space, tmp_path, {0: [record(0, 0, 0.5), record(0, 1, 0.7)]})
    assert list(frame["hardware"]) == ["chip", "other"]
    assert frame["energy_uj"].tolist() == [1.5, 9.0]
    assert frame["accuracy"].tolist() == [pytest.approx(0.6)] * 2
    assert not {"phi", "theta"} & set(frame)


def test_a_grid_is_averaged_point_by_point(space: SearchSpace, tmp_path: Path) -> None:
    grid = {"phi": np.array([0, 4]), "theta": np.array([0.5, 0.7, 1.0])}
    for repeat in (0, 1):
        arrays = {
            "accuracy": np.arange(6.0).reshape(2, 3) + repeat,
            "spikes_total": np.full((2, 3), 7),
            "chip/energy_uj": np.ones((2, 3)) * (1 + repeat),
            "chip/fits": np.full((2, 3), repeat == 0),
            "other/energy_uj": np.zeros((2, 3)),
        }
        folder = store.run_folder(tmp_path, 0, repeat)
        folder.mkdir(parents=True)
        store.save_arrays(folder / "surface.npz", grid | arrays)
    runs = [{**record(0, repeat, 0.5), "files": {"surface.npz": ""}} for repeat in (0, 1)]
    for run in runs:
        run["columns"]["spikes_total"] = 9
    frame = tables.points_table(space, tmp_path, {0: runs})
    assert len(frame) == 2 * (1 + 6)
    chip = frame[frame["hardware"] == "chip"]
    end, chip = chip.iloc[0], chip.iloc[1:]
    assert np.isnan(end["phi"]) and np.isnan(end["theta"])
    assert (end["accuracy"], end["spikes_total"]) == (0.5, 9)
    assert chip["phi"].tolist() == [0, 0, 0, 4, 4, 4]
    assert chip["theta"].tolist() == [0.5, 0.7, 1.0] * 2
    assert chip["accuracy"].tolist() == [0.5, 1.5, 2.5, 3.5, 4.5, 5.5]
    assert chip["accuracy_se"].tolist() == pytest.approx([0.5] * 6)
    assert chip["energy_uj"].tolist() == [1.5] * 6
    assert chip["fits"].tolist() == [False] * 6
    assert chip["spikes_total"].dtype == np.int64
    assert frame[frame["hardware"] == "other"]["energy_uj"].tolist()[1:] == [0.0] * 6


def test_read_outs_before_the_end_are_points(space: SearchSpace, tmp_path: Path) -> None:
    folder = store.run_folder(tmp_path, 0, 0)
    folder.mkdir(parents=True)
    arrays = {
        "decision_latency_ms": np.array([2.0, 4.0]),
        "accuracy": np.array([0.25, 0.5]),
        "n_weights": np.array([14, 28]),
        "chip/energy_uj": np.array([0.5, 1.0]),
        "other/energy_uj": np.array([4.5, 9.0]),
    }
    store.save_arrays(folder / "read_out.npz", arrays)
    run = {**record(0, 0, 0.5, itr_bits=1.5, t_c_ms=4.0), "files": {"read_out.npz": ""}}
    frame = tables.points_table(space, tmp_path, {0: [run], 1: [record(1, 0, 0.7)]})
    first = frame[(frame["trial"] == 0) & (frame["hardware"] == "other")]
    assert first["read_out_ms"].isna().tolist() == [True, False]
    assert first["read_out_ms"].iloc[1] == first["decision_latency_ms"].iloc[1] == 2.0
    assert first["accuracy"].tolist() == [0.5, 0.25] and first["n_weights"].tolist() == [28, 14]
    assert first["energy_uj"].tolist() == [9.0, 4.5]
    assert first["t_c_ms"].tolist() == [4.0, 4.0]  # of the design
    assert first["itr_bits"].isna().tolist() == [False, True]  # of one answer, which this row is not
    assert first["model.hidden"].tolist() == ["[4]"] * 2
    assert frame["fits"].dtype == "boolean" and frame["read_out_ms"].isna().sum() == 4


def test_a_joint_net_has_points_of_each_head(space: SearchSpace, tmp_path: Path) -> None:
    run = record(0, 0, 0.4)
    heads = {
        name: {"columns": {**run["columns"], "accuracy": accuracy}, "hardware": run["hardware"]}
        for name, accuracy in (("texture", 0.8), ("profile", 0.5))
    }
    folder = store.run_folder(tmp_path, 0, 0)
    folder.mkdir(parents=True)
    grid = {"phi": np.array([0]), "theta": np.array([0.5]), "accuracy": np.array([[0.7]])}
    store.save_arrays(folder / "surface_texture.npz", grid)
    runs = {0: [{**run, "of_heads": heads, "files": {"surface_texture.npz": ""}}]}
    frame = tables.points_table(space, tmp_path, runs)
    chip = frame[frame["hardware"] == "chip"]
    assert chip["task"].tolist() == ["texture", "texture", "profile"]
    assert chip["accuracy"].tolist() == [0.8, 0.7, 0.5]
    assert tables.trials_table(space, runs)["accuracy"].tolist() == [0.4]


def test_the_task_of_an_axis_of_targets_is_its_columns(tmp_path: Path) -> None:
    task = {"target": {"choice": ["fabric", ["fabric", {"column": "speed", "abs": True}]]}}
    data = {**tiny_study.plain()["data"], "columns": {"fabric": "label", "speed": "label"}}
    space = tiny_study.make_space(tmp_path, task=task, data=data)
    tiny_study.unregister()
    names = [
        tables.task_name(space, {"task.target": target}) for target in space.axes["task.target"].values or ()
    ]
    assert names == ["fabric", "fabric|speed"]
    assert len(tables.trials_table(space, {})) == 0
