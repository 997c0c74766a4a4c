"""A study from its search space to its tables, the same whatever the workers, the order and the stops."""

import dataclasses
import os
import re
import shutil

import numpy as np
import pytest
from pandas.testing import assert_frame_equal

import dse
from dse import store
from dse.config import ConfigError, load_space
from dse.data.dataset import load
from dse.data.dataset.cache import usual_root
from dse.data.recordings import RecordingError
from dse.measure import decision
from dse.measure.run import read_out
from dse.study import claim, data_sets, explore, results, runs, training
from dse.study import jobs as study_jobs
from dse.study.executors.work import Failure
from dse.study.ledger import read_entries
from dse.study.workers import Workers
from tests import spaces, tiny_study
from tests.tiny_study import make_space

COLUMNS = [
    *("accuracy", "accuracy_se", "n_weights", "spikes_per_inference", "spikes_total", "synaptic_operations"),
    *("decision_latency_ms", "hardware_latency_ms", "latency_ms", "energy_uj", "energy_uj_low"),
    *("energy_uj_high", "energy_dynamic_uj", "energy_static_uj", "energy_static_throttled_uj", "n_cores"),
    *("fits", "t_p_ms", "t_h_ms", "train_s", "dead_neurons", "status", "reason"),
]


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """Six designs trained by two workers without interruption."""
    folder = tmp_path_factory.mktemp("finished")
    return explore.run(make_space(folder), folder / "results", progress=False)


@pytest.fixture
def copied(finished, tmp_path):
    """A folder with the search space, the recordings and the results of the finished study."""
    for name in ("tiny.npz", "tiny.yaml"):
        shutil.copy(finished.folder.parents[1] / name, tmp_path / name)
    shutil.copytree(finished.folder, tmp_path / "results" / "tiny")
    return tmp_path


def timeless(frame):
    return frame.drop(columns="train_s")


def assert_same(one, other):
    assert_frame_equal(timeless(one.trials), timeless(other.trials), check_exact=True)
    assert_frame_equal(timeless(one.points()), timeless(other.points()), check_exact=True)


def finished_runs(folder):
    """Return what tells a run's record from one written again."""
    records = (folder / "results" / "tiny" / "runs").glob("*.npz")
    return {str(path): (path.stat().st_ino, path.stat().st_mtime_ns) for path in records}


def test_every_trial_has_its_record(finished):
    trials = finished.trials
    assert set(COLUMNS) <= set(trials)
    assert list(trials["trial"]) == list(range(6))
    assert list(zip(trials["model.hidden"], trials["model.true_rate"], strict=True)) == [
        (hidden, rate) for hidden in (4, 8, 16) for rate in (0.2, 0.8)
    ]
    assert set(trials["status"]) == {"finished"}
    assert list(trials["n_weights"]) == [28, 28, 56, 56, 112, 112]  # (4 channels + 3 classes) * hidden
    assert set(trials["decision_latency_ms"]) == {100.0}  # 20 steps of 5 ms
    assert (
        trials["accuracy"].is_monotonic_increasing or trials["accuracy"].iloc[-1] > trials["accuracy"].iloc[0]
    )
    assert set(trials["task"]) == {"fabric"}
    assert set(trials["family"]) == set(finished.points()["family"]) == {"fake"}


def test_the_folder_says_what_was_explored_and_where(finished):
    [session] = store.document(finished.folder, store.ENVIRONMENT)
    assert session["versions"]["numpy"] == np.__version__
    assert finished.space["model"]["hidden"] == {"choice": [4, 8, 16]}
    assert finished.objectives == [("accuracy", "max"), ("n_weights", "min"), ("energy_uj", "min")]
    [warning] = finished.warnings  # a grid of two phi is narrow
    assert warning.startswith("decision: the best setting of trials 0, 2, 3 and 2 more lies on the border of")
    assert (finished.folder / store.BOOK).exists()


def test_points_are_what_the_stored_spikes_say(finished):
    points = finished.points()
    assert len(points) == 6 * (1 + 2 * 3 + 19)  # the full read-out, the grid, earlier read-outs
    for number in (0, 5):
        [record] = finished.runs(number)
        folder = store.run_file(finished.folder, number, 0)
        response = store.response_of(store.load_arrays(folder / "response.npz"))
        data = load(usual_root() / record["data"])
        target = data.target[data.validation]
        done = response.spikes.cumsum(axis=1)
        own = points[points["trial"] == number]
        end, grid, early = own.iloc[0], own[own["phi"].notna()], own[own["read_out_ms"].notna()]
        assert (
            np.isnan(end["read_out_ms"])
            and np.isnan(end["phi"])
            and np.isnan(end["theta"])
            and end["undecided"] == 0
        )
        for name in ("accuracy", "energy_uj", "decision_latency_ms", "spikes_total", "synaptic_operations"):
            assert end[name] == finished.trials[name][number], name
        for _, row in grid.iterrows():
            found = decision.decide(response.output, row["phi"], row["theta"])
            spikes = done[np.arange(len(target)), found.step]
            assert row["accuracy"] == pytest.approx((found.label == target).mean())
            assert row["undecided"] == pytest.approx(1 - found.decided.mean())
            assert row["decision_latency_ms"] == pytest.approx(5 * (found.step + 1).mean())
            assert row["spikes_per_inference"] == pytest.approx(spikes.sum(axis=1).mean())
            assert row["spikes_total"] == spikes.sum()
            hidden = record["design"]["model.hidden"]
            assert row["synaptic_operations"] == pytest.approx((spikes @ [hidden, 3, 0]).mean())
        assert early["read_out_ms"].tolist() == [5.0 * (k + 1) for k in range(19)]
        for k, (_, row) in enumerate(early.iterrows()):
            label = read_out(response.output[:, : k + 1])
            assert row["accuracy"] == pytest.approx((label == target).mean())
            assert row["decision_latency_ms"] == row["read_out_ms"]
            assert row["spikes_total"] == done[:, k].sum()
        label = read_out(response.output)
        assert finished.trials["accuracy"][number] == pytest.approx((label == target).mean())
        confusion = store.load_arrays(folder / "confusion.npz")["validation"]
        assert confusion.trace() == (label == target).sum()
        assert confusion.sum(axis=1).tolist() == [6, 6, 6]


def test_one_worker_and_another_order_of_axes_give_the_same_designs(finished, tmp_path, workers):
    model = {"kind": "fake", "true_rate": {"choice": [0.8, 0.2]}, "hidden": {"choice": [[16], [8], [4]]}}
    space = make_space(tmp_path, model=model, search={"sampler": "grid", "batch": 6})
    other = explore.run(space, tmp_path / "results", jobs=1, progress=False)
    keys = ["model.hidden", "model.true_rate", "phi", "theta"]
    one, two = (
        timeless(x.points()).drop(columns="trial").sort_values(keys, ignore_index=True)
        for x in (finished, other)
    )
    assert list(other.trials["model.hidden"]) != list(finished.trials["model.hidden"])
    assert_frame_equal(one, two[one.columns], check_exact=True)


def cached(root):
    """Return the folders of a cache: data sets, and the spikes that they name."""
    found = {"spikes": [], "dataset": []}
    for path in sorted(root.glob("*/meta.json")):
        found[store.read_json(path)["schema"].split("/")[1]].append(path.parent)
    return found


def test_tasks_share_spikes_with_each_other_and_with_another_study(tmp_path, monkeypatch):
    monkeypatch.setenv("DSE_CACHE", str(tmp_path / "cache"))
    preparations = []
    stream = Workers.stream

    def watched(self, function, given):
        given = list(given)
        preparations.extend(given if function is data_sets.prepare else [])
        return stream(self, function, given)

    monkeypatch.setattr(Workers, "stream", watched)
    data = {**tiny_study.plain()["data"], "columns": {"fabric": "label", "speed": "label"}}
    task = {"target": {"choice": ["fabric", "speed"]}}
    execution = {"jobs": 4, "threads": 3}
    space = make_space(tmp_path, data=data, task=task, model={"kind": "fake"}, execution=execution)
    found = explore.run(space, tmp_path / "results", progress=False)
    assert set(found.trials["status"]) == {"finished"}
    assert {name: len(folders) for name, folders in cached(tmp_path / "cache").items()} == {
        "spikes": 1,
        "dataset": 2,
    }
    assert [(len(job.designs), job.threads) for job in preparations] == [(2, 12)], "one waits for the other"
    shutil.rmtree(tmp_path / "results")
    explore.run(space, tmp_path / "results", progress=False)
    assert len(preparations) == 1, "another study finds the data sets"
    assert not (tmp_path / "results" / "tiny" / "data").exists()

    window = {"n_steps": {"choice": [10, 20]}}
    space = make_space(
        tmp_path, data=data, task=task, model={"kind": "fake"}, execution=execution, window=window
    )
    explore.run(space, tmp_path / "other", progress=False)
    assert [(len(job.designs), job.threads) for job in preparations[1:]] == [(2, 6), (2, 6)]


def test_data_sets_that_somebody_removed_are_prepared_again(finished, copied, monkeypatch):
    monkeypatch.setenv("DSE_CACHE", str(copied / "cache"))
    before = finished_runs(copied)
    assert_same(explore.run(make_space(copied), copied / "results", progress=False), finished)
    assert finished_runs(copied) == before and not any(cached(copied / "cache").values())
    store.run_file(copied / "results" / "tiny", 0, 0).unlink()
    assert_same(explore.run(make_space(copied), copied / "results", progress=False), finished)
    assert [len(folders) for folders in cached(copied / "cache").values()] == [1, 1]


def test_a_data_set_that_is_evicted_before_its_worker_asks_is_prepared_again(finished, copied, monkeypatch):
    stream = Workers.stream

    def evicts(self, function, jobs):
        if function is study_jobs.train:
            shutil.rmtree(copied / "cache")
        return stream(self, function, jobs)

    monkeypatch.setattr(Workers, "stream", evicts)
    monkeypatch.setenv("DSE_CACHE", str(copied / "cache"))
    store.run_file(copied / "results" / "tiny", 0, 0).unlink()
    assert_same(explore.run(make_space(copied), copied / "results", jobs=1, progress=False), finished)
    assert [len(folders) for folders in cached(copied / "cache").values()] == [1, 1]


def test_a_target_that_is_not_there_fails_no_other(tmp_path):
    task = {"target": {"choice": ["fabric", "absent"]}}
    space = make_space(tmp_path, task=task, model={"kind": "fake"})
    trials = explore.run(space, tmp_path / "results", progress=False).trials.set_index("task.target")
    assert trials.loc["fabric", "status"] == "finished"
    assert trials.loc["absent", "reason"].startswith("RecordingError: task.target: no column 'absent'")


def test_what_a_worker_had_prepared_before_it_died_is_used(tmp_path, monkeypatch):
    stream, n_designs = Workers.stream, []

    def dies(self, function, jobs):
        if function is not data_sets.prepare:
            yield from stream(self, function, jobs)
            return
        for job in jobs:
            n_designs.append(len(job.designs))
            first = dict(list(job.designs.items())[:1])
            assert not list(data_sets.prepare(dataclasses.replace(job, designs=first)))
            yield job, Failure.died("signal 9")

    monkeypatch.setattr(Workers, "stream", dies)
    monkeypatch.setenv("DSE_CACHE", str(tmp_path / "cache"))
    data = {**tiny_study.plain()["data"], "columns": {"fabric": "label", "speed": "label"}}
    task = {"target": {"choice": ["fabric", "speed"]}}
    space = make_space(tmp_path, data=data, task=task, model={"kind": "fake"})
    found = explore.run(space, tmp_path / "results", jobs=1, progress=False)
    trials = found.trials.set_index("task.target")
    assert trials.loc["fabric", "status"] == "finished"
    assert trials.loc["speed", "status"] == "finished", "it is prepared again"
    assert n_designs == [2, 1], "and the other is not"


def test_nothing_is_evicted_that_a_study_needs(tmp_path, monkeypatch):
    monkeypatch.setenv("DSE_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("DSE_CACHE_GIB", "0")
    space = make_space(tmp_path, window={"n_steps": {"choice": [10, 20]}}, model={"kind": "fake"})
    found = explore.run(space, tmp_path / "results", jobs=2, progress=False)
    assert set(found.trials["status"]) == {"finished"}
    for entry in (tmp_path / "cache").glob("*/entry.json"):
        os.utime(entry, (0, 0))
    explore.run(space, tmp_path / "results", progress=False)
    assert not any(cached(tmp_path / "cache").values()), "a day later they are evicted"


def test_a_cache_that_cannot_be_written_is_replaced_by_the_studys_own(tmp_path, monkeypatch, capsys):
    (tmp_path / "file").touch()
    monkeypatch.setenv("DSE_CACHE", str(tmp_path / "file" / "cache"))
    found = explore.run(make_space(tmp_path, model={"kind": "fake"}), tmp_path / "results", jobs=1)
    assert len(cached(found.folder / "cache")["dataset"]) == 1
    assert "prepared data cannot be cached for other runs and are written to " in capsys.readouterr().err
    monkeypatch.setenv("DSE_CACHE_GIB", "little")
    with pytest.raises(store.StoreError, match="DSE_CACHE_GIB must be a number of GiB"):
        explore.run(make_space(tmp_path), tmp_path / "more", progress=False)


def test_warnings_stay_with_the_study(tmp_path, capsys):
    tiny_study.write_recordings(tmp_path / "tiny.npz")
    with np.load(tmp_path / "tiny.npz") as file:
        arrays = dict(file)
    signal = np.repeat(100.0 * arrays["label"][:, None, None], 20, axis=1) + np.arange(20)[None, :, None]
    np.savez(tmp_path / "tiny.npz", signal=signal, label=arrays["label"])
    data = {"kind": "time_series", "file": "tiny.npz", "step_ms": 5.0, "columns": {"fabric": "label"}}
    encoder = {"kind": "send_on_delta", "thresholds": [2]}
    space = make_space(tmp_path, data=data, encoder=encoder, model={"kind": "fake"})
    for _ in range(2):
        found = explore.run(space, tmp_path / "results", jobs=1)
        level, border = found.warnings
        assert level.startswith("resting level") and border.startswith(
            "decision: the best setting of trial 0"
        )
    assert capsys.readouterr().err.count("warning: resting level") == 1


def test_failures_are_recorded_and_the_rest_goes_on(tmp_path, capsys):
    moods = ["raise", "fine", "nan", "slow"]
    space = make_space(
        tmp_path,
        model={"kind": "fake", "mood": {"choice": moods}, "hidden": [16]},
        window={"n_steps": {"choice": [20, 99]}},
    )
    found = explore.run(space, tmp_path / "results")
    trials = found.trials.set_index(["window.n_steps", "model.mood"])
    assert trials.loc[(20, "raise"), "reason"] == "ValueError: hidden must be kind"
    assert trials.loc[(20, "fine"), "status"] == "finished"
    for mood in moods:
        assert "RecordingError: " in trials.loc[(99, mood), "reason"]
    failed = found.trials[found.trials["status"] == "failed"]
    assert len(failed) == 5
    assert failed["accuracy"].isna().all()
    assert set(found.points()["trial"]) == {1, 2, 3}
    assert "8/8" in capsys.readouterr().err
    details = found.runs(0)[0]["details"]
    assert "in fit" in details and "hidden must be kind" in details

    before = finished_runs(tmp_path)
    again = explore.run(space, tmp_path / "results", progress=False)
    assert finished_runs(tmp_path) == before
    assert_same(again, found)


def test_what_the_machine_did_fails_no_design(tmp_path, capsys, forked):
    moods = ["memory", "fine", "killed_twice", "killed"]
    space = make_space(
        tmp_path,
        model={"kind": "fake", "mood": {"choice": moods}, "hidden": [16], "gate": str(tmp_path / "deaths")},
        search={"sampler": "grid", "repeats_on_front": 2},
    )
    found = explore.run(space, tmp_path / "results")
    assert (tmp_path / "deaths").read_bytes()[:3] == b"...", "killed, killed alone, trained"
    trials = found.trials.set_index("model.mood")
    assert dict(trials["status"]) == {"fine": "finished", "killed_twice": "finished"}
    reason = "trial 3 is not trained: worker died: signal 9; the next run tries again"
    assert reason in capsys.readouterr().err
    [note] = [text for text in found.warnings if text.startswith(runs.UNTRAINED)]
    assert "2 designs, trial 0, 3, because of the machine" in note
    assert [entry.is_reported for entry in read_entries(found.folder)] == [False, True, True, False]

    before = finished_runs(tmp_path)
    with pytest.MonkeyPatch.context() as patch:  # the machine is well again
        patch.setattr(Workers, "stream", in_this_process)
        patch.setattr(tiny_study.Fake, "fit", well(tiny_study.Fake.fit))
        again = explore.run(space, tmp_path / "results", progress=False)
    assert set(again.trials["status"]) == {"finished"} and len(again.trials) == 4
    assert before.items() <= finished_runs(tmp_path).items()
    assert not [text for text in again.warnings if text.startswith(runs.UNTRAINED)]


def well(fit):
    """Return a training in which nothing happens that the model's mood says."""
    return lambda model, *arguments: fit(dataclasses.replace(model, mood="fine"), *arguments)


def in_this_process(_, function, jobs):
    return ((job, part) for job in jobs for part in function(job))


TOGETHER = {**tiny_study.plain()["model"], "kind": "together"}


def sizes(found):
    """Return how many runs were in the cohort of each finished run."""
    runs = [run for trial in store.runs_in(found.folder) for run in store.runs_of(found.folder, trial)]
    return [
        int(store.load_arrays(run / "history.npz")["members"])
        for run in runs
        if "history.npz" in store.read_record(run)["files"]
    ]


def gib(megabytes):
    """Return a memory budget that leaves so much to models, and half a megabyte to their few samples."""
    return (study_jobs.PROCESS_BYTES + megabytes * 2**20 + 2**19) / 2**30


def test_tables_do_not_depend_on_cohorts(tmp_path):
    found = {}
    for name, execution, expected in (
        ("one", {"jobs": 1}, [6, 6, 6, 6, 6, 6]),
        ("two", {"jobs": 2}, [3, 3, 3, 3, 3, 3]),
        ("alone", {"jobs": 1, "memory_gib": gib(1)}, [1, 1, 1, 1, 1, 1]),
        ("pairs", {"jobs": 2, "memory_gib": gib(2)}, [1, 1, 2, 2, 2, 2]),
    ):
        (tmp_path / name).mkdir()
        space = make_space(tmp_path / name, model=TOGETHER, search={"sampler": "grid"}, execution=execution)
        found[name] = explore.run(space, tmp_path / name, progress=False)
        assert sorted(sizes(found[name])) == expected
        assert_same(found[name], found["one"])
    assert found["one"].trials["first_sample"].nunique() == 1, "designs must share what orders the batches"


def test_what_differs_in_data_repeat_or_share_trains_apart(tmp_path):
    space = make_space(
        tmp_path,
        model={**TOGETHER, "hidden": {"choice": [[4], [8]]}, "true_rate": 0.8},
        window={"n_steps": {"choice": [10, 20]}},
        training={"epochs": 1, "batch_size": {"choice": [4, 8]}},
        search={"sampler": "grid", "repeats": 2},
        execution={"jobs": 1},
    )
    found = explore.run(space, tmp_path, progress=False)
    assert sizes(found) == [2] * 16
    first = [[record["columns"]["first_sample"] for record in found.runs(number)] for number in range(8)]
    assert len({tuple(pair) for pair in first}) == 1
    assert first[0][0] != first[0][1], "repeats must order batches differently"


def test_a_guilty_member_fails_alone(tmp_path, forked):
    moods = ["fine", "killed", "diverged", "misshapen", "forgotten", "raise", "crowded"]
    changes = {
        "model": {**TOGETHER, "hidden": {"choice": [[4], [8]]}, "true_rate": 0.5, "mood": {"choice": moods}},
        "search": {"sampler": "grid"},
    }
    space = make_space(tmp_path, **changes, execution={"jobs": 1})
    found = explore.run(space, tmp_path / "together", progress=False)
    reasons = found.trials.set_index(["model.hidden", "model.mood"])["reason"].unstack()
    assert set(reasons["fine"]) == {""}
    assert set(reasons["crowded"]) == {""}
    assert "killed" not in reasons, "a worker's death is no failure of its design"
    [note] = [text for text in found.warnings if text.startswith(runs.UNTRAINED)]
    assert "2 designs, trial 1, 8, because of the machine (worker died: signal 9)" in note
    assert set(reasons["diverged"]) == {"TrainingDiverged: loss is not finite in epoch 1"}
    assert (
        reasons["misshapen"]
        .str.startswith("ValueError: a response must have at least one sample and one step")
        .all()
    )
    assert set(reasons["forgotten"]) == {"RuntimeError: Together.fit_cohort left out designs [0]"}
    assert set(reasons["raise"]) == {"ValueError: hidden must be kind"}
    details = found.runs(3)[0]["details"]
    assert "in measure" in details

    apart = make_space(tmp_path, **changes, execution={"jobs": 2, "memory_gib": gib(1)})
    assert_same(explore.run(apart, tmp_path / "apart", progress=False), found)


def test_a_design_beyond_the_budget_is_not_trained_until_there_is_more(tmp_path):
    changes = {
        "model": {**TOGETHER, "hidden": [4], "megabytes": {"choice": [1, 3]}},
        "search": {"sampler": "grid"},
    }
    (tmp_path / "whole").mkdir()
    whole = explore.run(make_space(tmp_path / "whole", **changes), tmp_path / "whole", progress=False)
    results = tmp_path / "results"
    tight = make_space(tmp_path, **changes, execution={"memory_gib": gib(2)})
    trials = explore.run(tight, results, progress=False).trials.set_index("model.megabytes")
    assert set(trials.loc[1, "status"]) == {"finished"}
    needed, budget = (study_jobs.PROCESS_BYTES + n * 2**20 for n in (3, 2))
    [reason] = set(trials.loc[3, "reason"])
    found = re.fullmatch(
        r"MemoryBudget: training needs (\d+) bytes, more than the (\d+) of a process; "
        r"execution\.memory_gib: 0\.32 is enough",
        reason,
    )
    assert found, reason
    needed, budget = map(int, found.groups())
    assert budget == study_jobs.PROCESS_BYTES + 2 * 2**20 + 2**19 < needed
    assert 3 * 2**20 <= needed - study_jobs.PROCESS_BYTES < 3 * 2**20 + 2**19
    kept = finished_runs(tmp_path)
    explore.run(tight, results, progress=False)
    assert finished_runs(tmp_path) == kept
    more = make_space(tmp_path, **changes, execution={"memory_gib": 0.32})
    assert_same(explore.run(more, results, progress=False), whole)
    assert set(kept) == set(finished_runs(tmp_path))


def test_real_networks_do_not_depend_on_cohorts(tmp_path, monkeypatch):
    space = load_space(spaces.write_space(tmp_path, ("search: {sampler: grid, batch: 2}", "")))
    with monkeypatch.context() as patch:
        patch.setattr(training, "_LONGEST_S", 0.0)
        alone = explore.run(space, tmp_path / "alone", progress=False)
    counts = []
    plain = training.Training._planned

    def counted(self, *arguments):
        planned = plain(self, *arguments)
        counts.extend(len(cohort.runs) for cohort in planned)
        return planned

    monkeypatch.setattr(training.Training, "_planned", counted)
    together = explore.run(space, tmp_path / "together", progress=False)
    assert counts == [3, 3]
    assert_same(together, alone)


def test_front_designs_are_repeated_and_averaged(tmp_path):
    space = make_space(tmp_path, search={"sampler": "grid", "repeats": 1, "repeats_on_front": 3})
    found = explore.run(space, tmp_path / "results", progress=False)
    front = set(dse.open(found.folder).skyline().rows["trial"])
    repeats = found.trials.set_index("trial")["repeats"]
    assert set(repeats[sorted(front)]) == {3}
    assert set(repeats) <= {1, 3}
    number = min(front)
    records = found.runs(number)
    accuracy = np.array([record["columns"]["accuracy"] for record in records])
    assert len(set(accuracy)) > 1, "repeats must have seeds of their own"
    row = found.trials.set_index("trial").loc[number]
    assert row["accuracy"] == pytest.approx(accuracy.mean())
    assert row["accuracy_se"] == pytest.approx(accuracy.std(ddof=1) / np.sqrt(3))
    surfaces = np.stack(
        [
            store.load_arrays(store.run_file(found.folder, number, k) / "surface.npz")["accuracy"]
            for k in range(3)
        ]
    )
    points = found.points()
    points = points[(points["trial"] == number) & points["phi"].notna()]
    assert np.allclose(points["accuracy"], surfaces.mean(axis=0).ravel())
    assert np.allclose(points["accuracy_se"], (surfaces.std(axis=0, ddof=1) / np.sqrt(3)).ravel())
    assert_same(explore.run(space, tmp_path / "results", progress=False), found)


def test_a_sampler_that_learns_asks_the_same_after_an_interruption(tmp_path, monkeypatch):
    changes = {
        "model": {"kind": "fake", "hidden": {"range": [1, 60]}, "true_rate": {"range": [0.0, 1.0]}},
        "execution": {"jobs": 1},
        "search": {"sampler": "tpe", "n_trials": 6, "batch": 3, "startup": 3},
    }
    for name in ("whole", "stopped"):
        (tmp_path / name).mkdir()
    whole = explore.run(make_space(tmp_path / "whole", **changes), tmp_path / "whole", progress=False)
    space = make_space(tmp_path / "stopped", **changes)
    plain_stream, count = Workers.stream, 0

    def stop_after_four(self, function, jobs):
        nonlocal count
        for found in plain_stream(self, function, jobs):
            yield found
            count += function is study_jobs.train
            if count == 4:
                raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Workers, "stream", stop_after_four)
        with pytest.raises(KeyboardInterrupt):
            explore.run(space, tmp_path / "stopped", progress=False)
    assert len(results.open(tmp_path / "stopped" / "tiny").trials) == 4
    assert_same(explore.run(space, tmp_path / "stopped", progress=False), whole)


def test_more_hardware_needs_no_training(finished, copied):
    before = finished_runs(copied)
    more = make_space(copied, hardware=["loihi1_silicon", "op_4.6_0.9"])
    found = explore.run(more, copied / "results", progress=False)
    assert finished_runs(copied) == before
    points = found.points()
    assert points["hardware"].unique().tolist() == ["loihi1_silicon", "op_4.6_0.9"]
    own = points[points["hardware"] == "loihi1_silicon"].reset_index(drop=True)
    assert_frame_equal(own[finished.points().columns], finished.points(), check_dtype=False)
    assert (points[points["hardware"] == "op_4.6_0.9"]["energy_uj"] > 0).all()
    assert (found.folder / "hardware" / "op_4.6_0.9.yaml").is_file()

    priced = finished.points(["op_4.6_0.9"])
    assert priced["energy_uj"].tolist() == points[points["hardware"] == "op_4.6_0.9"]["energy_uj"].tolist()

    # What a sampler was told is of the first chip, with the figures that it had.
    first = make_space(copied, hardware=["op_4.6_0.9", "loihi1_silicon"])
    with pytest.raises(ConfigError, match=r"hardware is .* was started with"):
        explore.run(first, copied / "results", progress=False)
    kept = found.folder / "hardware" / "loihi1_silicon.yaml"
    store.write_text(kept, "# looked at\n" + store.read_text(kept))
    explore.run(more, copied / "results", progress=False)
    store.write_text(kept, store.read_text(kept).replace("value: 35.5", "value: 35.4"))
    with pytest.raises(ConfigError, match=r"loihi1_silicon: the numbers differ from those in .*yaml; change"):
        explore.run(more, copied / "results", progress=False)


def test_more_trials_go_on_and_any_other_change_is_refused(finished, copied):
    before = finished_runs(copied)
    shutil.move(copied / "tiny.npz", copied / "moved.npz")
    data = tiny_study.plain()["data"] | {"file": "moved.npz"}
    more = make_space(
        copied, data=data, execution={"jobs": 1}, search={"sampler": "grid", "batch": 4, "n_trials": 6}
    )
    with pytest.raises(ConfigError, match=r"search\.n_trials is 6, but .* was started with None"):
        explore.run(more, copied / "results", progress=False)
    same = make_space(copied, data=data, execution={"jobs": 1})
    assert_same(explore.run(same, copied / "results", progress=False), finished)
    assert finished_runs(copied) == before

    other = make_space(
        copied, data=data, seed=8, training={"epochs": 3}, execution={"jobs": 3, "memory_gib": 2}
    )
    with pytest.raises(ConfigError) as caught:
        explore.run(other, copied / "results", progress=False)
    assert [fault.message.split(" is ")[0] for fault in caught.value.faults] == ["seed", "training.epochs"]
    assert "use another study name or --results folder" in str(caught.value)

    cuda = make_space(copied, data=data, execution={"device": "cuda"})
    with (
        pytest.MonkeyPatch.context() as patch,
        pytest.raises(ConfigError, match=r"execution\.device is 'cuda', but .* was started with 'cpu'"),
    ):
        patch.setattr(explore, "missing", lambda device: None)
        explore.run(cuda, copied / "results", progress=False)


def test_fewer_trials_first_and_more_later(finished, tmp_path):
    search = {"sampler": "grid", "batch": 4}
    first = explore.run(
        make_space(tmp_path, search={**search, "n_trials": 2}), tmp_path / "results", progress=False
    )
    assert len(first.trials) == 2
    before = finished_runs(tmp_path)
    later = explore.run(make_space(tmp_path, search=search), tmp_path / "results", progress=False)
    assert before.items() <= finished_runs(tmp_path).items()
    assert_same(later, finished)


def test_other_recordings_are_refused(copied):
    tiny_study.write_recordings(copied / "tiny.npz", seed=1)
    with pytest.raises(ConfigError, match="the recordings differ from those that trial 0 was trained on"):
        explore.run(make_space(copied), copied / "results", progress=False)


def test_recordings_that_fit_no_design_stop_the_study_and_leave_it_open(tmp_path):
    tiny_study.write_recordings(tmp_path / "tiny.npz")
    space = make_space(tmp_path, window={"n_steps": 99})
    with pytest.raises(RecordingError, match="99"):
        explore.run(space, tmp_path / "results", jobs=1, progress=False)
    with pytest.raises(store.StoreError, match="is not the folder of a study with results"):
        results.open(tmp_path / "results" / "nothing")
    good = make_space(tmp_path, model={"kind": "fake"})
    assert len(explore.run(good, tmp_path / "results", jobs=1, progress=False).trials) == 1


def test_a_study_that_another_command_works_on_is_refused(copied, monkeypatch):
    monkeypatch.setattr(claim, "_PATIENCE_S", 0)
    with (
        store.exclusive(copied / "results" / "tiny"),
        pytest.raises(store.StoreError, match="another process is running this study"),
    ):
        explore.run(make_space(copied), copied / "results", progress=False)
