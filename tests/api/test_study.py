"""Studies as notebooks use them."""

import os
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

import dse
from dse.api.choice import NothingFeasible
from dse.skyline.constraints import ExpressionError

SPACE = {
    "task": {"target": "label"},
    "split": {"stratified": {"validation": 0.3}},
    "encoder": {"kind": "send_on_delta", "thresholds": [0.2]},
    "model": {"kind": "snn", "hidden": {"choice": [4, 8]}},
    "training": {"epochs": 2},
    "hardware": "loihi1_silicon",
}


def waves():
    label = np.repeat([0, 1], 12)
    phase = np.random.default_rng(0).uniform(0, 6, (24, 1))
    return np.sin(np.arange(40)[None] * (0.1 + 0.4 * label[:, None]) + phase), label


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    folder = tmp_path_factory.mktemp("door")
    signals, labels = waves()
    data = dse.data.from_arrays(signals, labels, step_ms=4, file=folder / "waves")
    rows = []
    study = dse.run({"data": data, **SPACE}, folder / "results", progress=False, on_trial=rows.append)
    return study, rows


def test_a_dict_runs_and_each_trial_is_reported(ran):
    study, rows = ran
    assert sorted(row["trial"] for row in rows) == [0, 1] and {row["status"] for row in rows} == {"finished"}
    assert {row["trial"]: row["accuracy"] for row in rows} == dict(
        zip(study.trials["trial"], study.trials["accuracy"], strict=True)
    )
    again = []
    resumed = dse.run(
        {"data": dict(study.space["data"]), **SPACE},
        study.folder.parent,
        progress=False,
        on_trial=again.append,
    )
    assert again == [] and len(resumed) == len(study) == 2 and bool(study)
    assert [goal.column for goal in study.objectives] == ["accuracy", "n_weights", "energy_uj"]


def test_one_line_and_a_small_page(ran):
    study, _ = ran
    assert repr(study).startswith("<Study study: 2 finished, accuracy up to ") and "\n" not in repr(study)
    page = study._repr_html_()
    assert "<table" in page and "n_weights" in page
    assert "<table" in study.skyline()._repr_html_()


def test_one_text_stands_for_a_list_of_one(ran):
    study, _ = ran
    budget = "n_weights <= 30"
    for budgets in (budget, [budget], (budget,)):
        picked = study.pick(budgets)
        assert picked.row is not None and picked.row["n_weights"] == 16
    assert study.best(budget)["trial"] == picked.row["trial"]
    assert study.best(budget, hardware="mcu_m4", confidence=0.01)["hardware"] == "mcu_m4"
    assert study.best(contacts_per_hour=60)["power_mw"] > 0
    fronts = [
        study.skyline(goals, where="n_weights <= 30", hardware="mcu_m4").rows
        for goals in (
            "accuracy:max,energy_uj:min",
            ["accuracy:max", ("energy_uj", "min")],
            {"accuracy": "max", "energy_uj": "min"},
        )
    ]
    assert all(front.equals(fronts[0]) for front in fronts) and set(fronts[0]["hardware"]) == {"mcu_m4"}
    sure = study.skyline(confidence=0.5).rows
    assert (sure["front_probability"] >= 0.5).all() and 0 < len(sure) <= len(study.skyline().rows)
    assert set(study.skyline(targets="c99").rows["target"]) == {"c99"}


def test_what_is_picked_is_evaluated_as_its_folder_is(ran, tmp_path):
    study, _ = ran
    bundle = study.pick().export(tmp_path / "bundle")
    file = study.space["data"]["file"]
    found = dse.evaluate(bundle, file)
    assert found.columns == dse.evaluate(tmp_path / "bundle", file).columns
    assert found.columns == dse.evaluate(study.pick(), file).columns
    assert len(found.label) == 24 and found.accuracy > 0.5


def test_figures_and_optuna(ran):
    study, _ = ran
    assert "front" in dir(study.plot) and study.plot.front().data
    assert study.plot.confusion(study.best()).data and study.plot.learning(0).data
    copy = study.to_optuna()
    assert [trial.params["model.hidden"] for trial in copy.trials] == [4, 8]
    assert copy.metric_names == ["accuracy", "n_weights", "energy_uj"]
    assert copy.trials[0].values[0] == study.trials["accuracy"][0]


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda study: study.pick(3), TypeError, "budgets"),
        (lambda study: study.pick([3]), TypeError, "budgets"),
        (lambda study: study.pick("n_weights <= 3", maximise=3), TypeError, "maximise"),
        (lambda study: study.pick(confidence=2), TypeError, r"confidence must be in \(0, 1\], got 2"),
        (lambda study: study.pick(draws="big"), TypeError, "draws must be an integer.*, got 'big'"),
        (lambda study: study.pick(hardwar="mcu_m4"), TypeError, "Did you mean 'hardware'"),
        (lambda study: study.pick(by="task"), ExpressionError, "by must be absent"),
        (lambda study: study.pick("n_wights <= 3"), ExpressionError, "Did you mean 'n_weights'"),
        (lambda study: study.skyline(3), TypeError, "objectives must be like 'accuracy:max,energy_uj:min'"),
        (lambda study: study.skyline([3]), TypeError, "objectives must be pairs such as"),
        (lambda study: study.skyline(where={}), TypeError, "where"),
        (
            lambda study: study.best("n_weights <= 0"),
            NothingFeasible,
            "the nearest misses n_weights<=0 by 16",
        ),
        (lambda study: study.plot.fornt(), AttributeError, "Did you mean 'front'"),
        (lambda study: study.plot.front(z=1), ValueError, "unknown key 'front.z'; known: "),
        (lambda study: study.plot.confusion("a"), TypeError, "design must be a trial's number or a row"),
        (lambda study: dse.open(3), TypeError, "folder must be the path of a study's folder, got 3"),
        (lambda study: dse.run(3), TypeError, "a search space must be a YAML file, .* got int"),
        (lambda study: dse.run({}, 3), TypeError, "results must be the path of a folder, got 3"),
        (lambda study: dse.run({}, jobs=0), TypeError, "jobs must be an integer >= 1, got 0"),
        (lambda study: dse.run({}, on_trial=3), TypeError, "on_trial must be a function of a row, got 3"),
        (lambda study: dse.run({"data": 3}), dse.ConfigError, "search space: section 'task' is required"),
    ],
)
def test_wrong_arguments_are_one_sentence(ran, call, error, message):
    with pytest.raises(error, match=message):
        call(ran[0])


def test_a_class_of_the_notebook_is_a_component_in_the_workers(tmp_path):
    (tmp_path / "notebook.py").write_text(
        textwrap.dedent(
            """
            import dataclasses
            import dse
            from dse.config.contracts import Encoder
            from dse.data.encoders.send_on_delta import SendOnDelta
            from dse.base.registry import param, register
            from tests.api.test_study import SPACE, waves

            @register("encoders", "louder")
            @dataclasses.dataclass(frozen=True)
            class Louder(Encoder):
                gain: float = param(2.0, doc="factor of the signal", low=0)

                def n_channels(self, n_in):
                    return SendOnDelta((0.2,)).n_channels(n_in)

                def positions(self, inputs):
                    return SendOnDelta((0.2,)).positions(inputs)

                def encode_all(self, signals, first, length):
                    return SendOnDelta((0.2 / self.gain,)).encode_all(signals, first, length)

            if __name__ == "__main__":
                data = dse.data.from_arrays(*waves(), step_ms=4)
                space = {**SPACE, "data": data, "encoder": {"kind": "louder", "gain": 2}}
                study = dse.run(space | {"execution": {"jobs": 1}}, progress=False)
                print(*study.trials["status"], len(study))
            """
        )
    )
    root = str(Path(__file__).parents[2])
    done = subprocess.run(
        [sys.executable, "notebook.py"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": root},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout == "finished finished 2\n", done.stderr
