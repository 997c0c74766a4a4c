"""A study of several kinds, from its search space to tables, front and page."""

import numpy as np
import pandas as pd
import pytest

import dse
from dse.show.dashboard.gather import gather_page
from dse.show.figures.front import FrontFigure
from dse.skyline import front
from dse.study import explore
from dse.study import trials as tables
from dse.study.record import RunRecord
from tests import tiny_study

MODEL = {
    "choice": [
        {"kind": "fake", "hidden": {"choice": [[4], [16]]}, "mood": {"choice": ["fine", "raise"]}},
        {"kind": "together", "true_rate": {"choice": [0.2, 0.8]}, "megabytes": 2},
    ]
}
OWN = ["model.fake.hidden", "model.fake.mood", "model.together.true_rate"]


@pytest.fixture(scope="module")
def space(tmp_path_factory):
    folder = tmp_path_factory.mktemp("families")
    yield tiny_study.make_space(folder, model=MODEL, execution={"jobs": 1})


@pytest.fixture(scope="module")
def done(space):
    return explore.run(space, space.source.parent / "results", progress=False)


def test_every_kind_is_trained_and_failures_are_rows(done):
    trials = done.trials
    assert trials["model.kind"].tolist() == ["fake"] * 4 + ["together"] * 2
    assert trials["status"].tolist() == ["finished", "failed"] * 2 + ["finished"] * 2
    assert done.runs(4)[0]["sections"]["model"]["kind"] == "together"
    assert done.runs(4)[0]["design"] == {"model.kind": "together", "model.together.true_rate": 0.2}


@pytest.mark.parametrize("name", ["trials", "points"])
def test_an_axis_of_another_kind_is_missing(done, name):
    frame = done.trials if name == "trials" else done.points()
    fake = frame["model.kind"] == "fake"
    for column in OWN:
        assert (frame[column].notna() == (fake == column.startswith("model.fake"))).all()
    assert frame["family"].tolist() == frame["model.kind"].tolist()
    assert set(frame["model.fake.hidden"].dropna()) == {4, 16}
    assert frame["model.together.true_rate"].dtype == np.float64
    assert set(frame["model.together.true_rate"].dropna()) == {0.2, 0.8}


def test_a_front_goes_across_kinds(done):
    found = dse.open(done.folder).skyline([("accuracy", "max"), ("n_weights", "min")])
    assert len(found.rows)
    only = dse.open(done.folder).skyline(where="model.kind == 'together'")
    assert set(only.rows["model.kind"]) == {"together"}
    few = front.skyline(done.points(), [("accuracy", "max")], "model.together.true_rate < 0.5")
    assert set(few.rows["model.together.true_rate"]) == {0.2}


def test_the_best_of_every_kind_is_repeated(tmp_path):
    search = {"sampler": "grid", "repeats_on_front": 2}
    space = tiny_study.make_space(tmp_path, model=MODEL, execution={"jobs": 1}, search=search)
    found = explore.run(space, tmp_path / "results", progress=False)
    fine = found.trials[found.trials["status"] == "finished"]
    assert fine.groupby("family")["repeats"].max().to_dict() == {"fake": 2, "together": 2}


def test_the_page_and_the_figure_take_missing_cells(done):
    frame = pd.concat([done.points(), done.trials[done.trials["status"] == "failed"]], ignore_index=True)
    page = gather_page(frame, name="families", objectives=done.objectives)
    assert [column for column in page["design"] if column in OWN] == OWN
    values = page["columns"]["model.together.true_rate"]["values"]
    assert {None, 0.2, 0.8} == set(values)
    figure = FrontFigure(("n_weights", "accuracy"))
    front = figure.gather(done)
    assert not any(word in "".join(front.hover) for word in ("nan", "None"))
    figure.draw(front)


def test_the_same_command_finds_everything_done(space, done):
    again = explore.run(space, done.folder.parent, progress=False)
    pd.testing.assert_frame_equal(again.trials, done.trials)


def test_a_missing_cell_has_the_type_of_its_axis(space):
    assert tables._missing(space.axes["model.fake.mood"]) is None
    assert np.isnan(tables._missing(space.axes["model.together.true_rate"]) or 0.0)


def test_a_table_of_one_kind_alone_can_be_written(space, tmp_path):
    design = {"model.kind": "together", "model.together.true_rate": 0.8}
    record = RunRecord(trial=0, repeat=0, design=design, seed=0, reason="no memory")
    frame = tables.trials_table(space, {0: [record]})
    frame.to_parquet(tmp_path / "x.parquet")
    assert pd.read_parquet(tmp_path / "x.parquet")["model.fake.mood"].isna().all()
