"""Trained runs at other precisions: what is kept, what is made again, and which designs are chosen."""

import dataclasses
import os
import shutil
import signal

import numpy as np
import pandas as pd
import pytest

import dse
from dse import store
from dse.base.records import Outcome
from dse.config import load_space
from dse.config.space import DecisionGrid
from dse.measure.run import measure
from dse.models.counts.knn import KNN
from dse.models.snn.family import SNN
from dse.models.snn.quantise import rounded
from dse.models.training import Training
from dse.study import explore, jobs, precision, rounding
from dse.study.precision import AS_TRAINED, common, evaluations, fronts, missing, near, refusal
from dse.study.rounding import Rounding, evaluate
from dse.study.workers import Workers
from tests.joint_data import joint
from tests.models.snn.toy import toy
from tests.saved_data import save
from tests.spaces import design_of, write_space

SETTINGS = ((4, 0.0), (2, 0.0), (4, 0.5))


def trained(folder, data, model, name="run"):
    """Train a run and return what it was asked to be."""
    if not (folder / "data").exists():
        save(data, folder / "data")
    run = jobs.Run(
        trial=0,
        repeat=0,
        design={},
        seed=1,
        sections=design_of(model, Training(epochs=2, batch_size=9, learning_rate=0.1)),
        data=folder / "data",
        base=folder,
        folder=store.run_file(folder / name, 0, 0),
        decision=DecisionGrid(np.array([0, 3]), np.array([0.4, 0.9])),
        hardware=(),
    )
    assert list(jobs.train(jobs.TrainingJob((run,)))) == [(0, None)]
    return run


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A run that was trained and never evaluated again."""
    return trained(tmp_path_factory.mktemp("made"), toy(), SNN(hidden=(10,), true_rate=0.5))


@pytest.fixture
def run(made, tmp_path):
    """The same with a folder of its own."""
    folder = store.run_file(tmp_path, 0, 0)
    folder.parent.mkdir()
    shutil.copy(made.folder, folder)
    return dataclasses.replace(made, folder=folder)


def done(run, *settings):
    assert list(evaluate(Rounding(run, settings))) == [(setting, None) for setting in settings]


def test_a_setting_holds_what_a_run_of_the_rounded_network_would_measure(run):
    done(run, *SETTINGS)
    data = toy()
    network = store.fitted_of(store.load_arrays(run.folder / "weights.npz"))
    assert [*evaluations(run.folder)] == sorted(SETTINGS)
    for setting, (path, record) in evaluations(run.folder).items():
        fewer = rounded(network, *setting)
        said = run.sections.model.respond(fewer, data, data.validation)
        outcome = Outcome(fewer, said, None, {})
        alone = measure(outcome, data, run.decision, (), setting[0])
        columns = record.measured.columns
        for name in ("accuracy", "n_weights", "synaptic_operations", "itr_bits"):
            assert columns[name] == alone.numbers.columns[name], name
        assert columns["n_weights"] == fewer.n_weights
        assert columns["n_weights_dense"] == network.n_weights_dense
        for name, arrays in alone.files.items():
            for key, array in store.load_arrays(path / name).items():
                np.testing.assert_array_equal(array, arrays[key], err_msg=f"{name} {key}")
        for name in ("surface.npz", "read_out.npz"):
            assert store.work_of(store.load_arrays(path / name)).weight_bits == setting[0]


def test_as_trained_it_is_the_run_itself(run):
    done(run, AS_TRAINED)
    [(path, found)] = evaluations(run.folder).values()
    record = store.read_record(run.folder)
    columns = found.measured.columns
    assert {"accuracy", "peak_state", "train_s", "transductive"} <= set(columns)
    assert {name: record["columns"][name] for name in columns} == columns
    assert found.files == ("confusion.npz", "read_out.npz", "surface.npz")
    for name in found.files:
        arrays, own = (store.load_arrays(each / name) for each in (path, run.folder))
        assert arrays.keys() == own.keys()
        for key, array in arrays.items():
            np.testing.assert_array_equal(array, own[key], err_msg=f"{name} {key}")


def test_a_joint_network_and_its_test_set(tmp_path):
    data = joint()
    data = dataclasses.replace(data, test=data.validation[:3])
    one = trained(tmp_path, data, SNN(hidden=(6,), true_rate=0.5))
    done(one, AS_TRAINED, (3, 0.25))
    fewer, same = (record for _, record in evaluations(one.folder).values())
    record = store.read_record(one.folder)
    assert same.measured.of_heads.keys() == record["of_heads"].keys() and len(record["of_heads"]) > 1
    for name, head in record["of_heads"].items():
        assert same.measured.of_heads[name].columns["accuracy"] == head["columns"]["accuracy"]
        assert f"surface_{name}.npz" in fewer.files
    assert same.measured.columns["accuracy_test"] == record["columns"]["accuracy_test"]
    assert fewer.files == same.files


@pytest.mark.parametrize("damage", ["truncated", "empty", "flipped", "missing", "other"])
def test_what_is_damaged_is_no_row_and_is_made_again(run, damage):
    done(run, *SETTINGS)
    before = evaluations(run.folder)
    path = precision.file_of(run.folder, (4, 0.5))
    content = path.read_bytes()
    if damage == "missing":
        path.unlink()
    elif damage == "other":
        shutil.copy(precision.file_of(run.folder, (4, 0.0)), path)
    else:
        middle = len(content) // 2
        flipped = (
            content[:middle] + bytes(255 - x for x in content[middle : middle + 64]) + content[middle + 64 :]
        )
        path.write_bytes({"truncated": content[:middle], "empty": b"", "flipped": flipped}[damage])
    assert [*evaluations(run.folder)] == [(2, 0.0), (4, 0.0)]
    assert missing(run.folder, SETTINGS) == ((4, 0.5),)
    done(run, *missing(run.folder, SETTINGS))
    assert missing(run.folder, SETTINGS) == ()
    assert evaluations(run.folder)[4, 0.5][1].measured == before[4, 0.5][1].measured


def test_what_was_measured_before_a_stop_stays(run):
    going = evaluate(Rounding(run, SETTINGS))
    assert next(going) == (SETTINGS[0], None)
    going.close()
    assert missing(run.folder, SETTINGS) == SETTINGS[1:]


def test_a_file_is_there_whole_or_not_at_all(run, monkeypatch):
    def torn(path, arrays, **how):
        path.write_bytes(b"PK")
        raise OSError(28, "no space")

    with monkeypatch.context() as patch:
        patch.setattr("dse.store.runs.save_arrays", torn)
        with pytest.raises(
            store.StoreError, match=r"precision/00000-0/4_0\.0\.npz: cannot be written: No space left"
        ):
            list(evaluate(Rounding(run, SETTINGS)))
    assert precision.files_of(run.folder) == []
    assert missing(run.folder, SETTINGS) == SETTINGS


def test_a_setting_that_fails_stops_no_other(run, monkeypatch):
    def moody(network, weight_bits, pruned):
        if weight_bits == 2:
            raise ValueError("weights must be kind")
        return rounded(network, weight_bits, pruned)

    monkeypatch.setattr(rounding, "rounded", moody)
    ended = dict(evaluate(Rounding(run, SETTINGS)))
    assert [setting for setting, why in ended.items() if why is None] == [(4, 0.0), (4, 0.5)]
    failed = ended[2, 0.0]
    assert failed is not None and failed.reason == "ValueError: weights must be kind"


def test_which_runs_have_other_precisions(run, tmp_path):
    assert refusal(run.folder) == ""
    (tmp_path / "others").mkdir()
    knn = trained(tmp_path / "others", toy(), KNN(window_ms=5.0), "knn")
    real = trained(tmp_path / "others", toy(), SNN(hidden=(4,), arithmetic="float32"), "real")
    assert refusal(knn.folder) == "is not a single stack of spiking layers"
    assert refusal(real.folder) == "runs in float32 arithmetic"


def test_repeats_have_the_settings_that_each_of_them_has(run, tmp_path):
    other = dataclasses.replace(run, folder=store.run_file(tmp_path / "other", 0, 0))
    other.folder.parent.mkdir(parents=True)
    shutil.copy(run.folder, other.folder)
    done(run, *SETTINGS)
    done(other, (2, 0.0), (4, 0.5))
    found = common([run.folder, other.folder])
    assert [*found] == [(2, 0.0), (4, 0.5)] and all(len(each) == 2 for each in found.values())
    assert common([run.folder, store.run_file(tmp_path, 7, 0)]) == {}


def test_designs_on_the_front_and_near_it():
    points = pd.DataFrame(
        {
            "trial": [0, 1, 2, 3, 4, 4, 5, 6],
            "accuracy": [0.9, 0.8, 0.88, 0.87, 0.5, 0.8, np.nan, 0.6],
            "n_weights": [100, 50, 120, 100, 60, 50, 10, np.nan],
        }
    )
    front = points.iloc[[0, 1, 5]]
    objectives = [("accuracy", "max"), ("n_weights", "min")]
    assert near(points, front, objectives, 0.02) == {0, 1, 2, 4}
    assert near(points, front, objectives, 0.03) == {0, 1, 2, 3, 4}
    assert near(points, front, objectives, 0.0) == {0, 1, 4}
    assert near(points, front, objectives, 1.0) == {0, 1, 2, 3, 4}
    # Below what can be reached with 60 weights, 0.8, not below the best of all.
    worse = points.assign(accuracy=points["accuracy"].replace(0.5, 0.79))
    assert near(worse.iloc[:5], points.iloc[:2], objectives, 0.02) == {0, 1, 2, 4}
    assert near(points, front, [("n_weights", "min")], 1.0) == {0, 1, 4}
    assert near(points, points.iloc[:1], [("accuracy", "max")], 0.05) == {0, 2, 3}
    assert near(points.iloc[:0], points.iloc[:0], objectives, 0.5) == set()


PRECISION = (
    "decision: {phi: [0, 2]",
    "precision: {weight_bits: [8, 3], pruned: [0, 0.5], within: 0.1}\ndecision: {phi: [0, 2]",
)
WANTED = {(3, 0.0), (3, 0.5), (8, 0.5)}
SMALL = ("hidden: {choice: [4, 8, 12]}", "hidden: {choice: [4, 8]}")
ONE = ("hidden: {choice: [4, 8, 12]}", "hidden: 4")
NO_AXIS = ("thresholds: {choice: [[1, 2], [1, 2, 4]]}", "thresholds: [1, 2]")


def stored(folder):
    """Return the files of settings in a study, and what tells each from one written again."""
    return {str(path.relative_to(folder)): path.stat().st_ino for path in folder.glob("precision/*/*.npz")}


def settings_of(found):
    """Return the settings that every trial's first run was evaluated at."""
    numbers = found.trials["trial"].tolist()
    folders = {number: store.run_file(found.folder, number, 0) for number in numbers}
    return {number: {*evaluations(folder)} for number, folder in folders.items()}


def test_a_study_evaluates_its_front_and_goes_on_where_it_was_stopped(tmp_path, monkeypatch):
    plain = load_space(write_space(tmp_path, SMALL))
    found = explore.run(plain, tmp_path, progress=False)
    assert stored(found.folder) == {}, "a file without the section"
    front = set(dse.open(found.folder).skyline().rows["trial"])

    space = load_space(write_space(tmp_path, SMALL, PRECISION))  # no other study: nothing is trained for it
    evaluate, count = rounding.evaluate, 0

    def stream(self, function, jobs):
        nonlocal count
        assert function is evaluate, "nothing else is left to do"
        for job in jobs:
            for ended in function(job):
                count += 1
                if count == 6:
                    raise KeyboardInterrupt
                yield job, ended

    with monkeypatch.context() as patch:
        patch.setattr(Workers, "stream", stream)
        with pytest.raises(KeyboardInterrupt):
            explore.run(space, tmp_path, progress=False)
    before = stored(found.folder)
    assert len(before) == 6  # the last was kept before anybody heard of it
    again = explore.run(space, tmp_path, progress=False)
    after = stored(found.folder)
    assert before.items() <= after.items() and len(after) % 3 == 0
    chosen = settings_of(again)
    assert front and all(chosen[number] == WANTED for number in front)
    assert all(own in (set(), WANTED) for own in chosen.values())

    damaged = next(iter(after))
    (found.folder / damaged).write_bytes(b"nothing")
    with monkeypatch.context() as patch:
        patch.setattr(Workers, "stream", stream)
        explore.run(space, tmp_path, progress=False)
    repaired = stored(found.folder)
    assert {name for name in after if after[name] != repaired[name]} == {damaged}


def dies_after_one(job):
    """Do as `evaluate` does, in a worker that is killed after its first setting."""
    yield next(evaluate(job))
    os.kill(os.getpid(), signal.SIGKILL)


def test_what_a_killed_worker_had_evaluated_stays(tmp_path, monkeypatch, capsys, forked):
    space = load_space(write_space(tmp_path, ONE, NO_AXIS, PRECISION))
    plain, asked = Workers.stream, []

    def stream(self, function, jobs):
        given = list(jobs)
        if function is evaluate:
            asked.extend(job.settings for job in given)
            function = dies_after_one if len(asked) == 1 else function
        return plain(self, function, given)

    monkeypatch.setattr(Workers, "stream", stream)
    found = explore.run(space, tmp_path)
    assert "stopped early" not in capsys.readouterr().err
    first, second = asked
    assert set(first) == WANTED and second == first[1:]
    assert settings_of(found) == {0: WANTED}
    points = found.points()
    at_the_end = points[points["phi"].isna() & points["read_out_ms"].isna()]
    pairs = zip(at_the_end["weight_bits"], at_the_end["pruned_after"], strict=True)
    assert sorted(pairs) == sorted({AS_TRAINED, *WANTED})
    assert (at_the_end["memory_bytes"] == at_the_end["n_weights"] * at_the_end["weight_bits"] / 8).all()
    assert at_the_end["energy_uj"].gt(0).all()


def test_other_precisions_do_not_change_which_designs_are_repeated(tmp_path):
    space = load_space(write_space(tmp_path))
    table = pd.DataFrame(
        {
            "task": "fabric",
            "family": "snn",
            "hardware": "chip",
            "trial": [0, 1, 1, 2],
            "accuracy": [0.9, 0.8, 0.95, 0.7],
            "n_weights": [100, 200, 20, 300],
            "weight_bits": [8, 8, 4, np.nan],
            "pruned_after": [0.0, 0.0, 0.5, np.nan],
        }
    )
    [(points, front)] = fronts(table, space.objectives)
    assert points["trial"].tolist() == [0, 1, 2] and front["trial"].tolist() == [0]
    bare = table.iloc[[0, 1, 3]].drop(columns=["weight_bits", "pruned_after", "hardware"])
    [(points, front)] = fronts(bare, space.objectives)
    assert points["trial"].tolist() == [0, 1, 2] and front["trial"].tolist() == [0]
    assert not list(fronts(bare.iloc[:0], space.objectives))


def test_families_without_other_precisions_are_left_out_with_a_note(tmp_path, capsys):
    model = "model: {kind: snn, hidden: {choice: [4, 8, 12]}, true_rate: 0.8}"
    other = "model: {kind: knn, window_ms: 20}"
    space = load_space(write_space(tmp_path, (model, other), PRECISION))
    found = explore.run(space, tmp_path)
    assert stored(found.folder) == {}
    assert (
        capsys.readouterr().err.count("precision: skipped: knn is not a single stack of spiking layers") == 1
    )
