"""Moved windows and groups that training leaves out, in studies whose answers are known."""

import numpy as np
import pandas as pd
import pytest
import yaml

import dse
from dse import store
from dse.config import ConfigError, load_space
from dse.study import explore, jobs
from dse.study.training import Training
from tests.installed import needs_papers

LABEL = np.tile(np.repeat([0, 1, 2], 3), 2)
FORCE = np.tile([1, 2, 3], 6)
REPETITION = np.repeat([0, 1], 9)
N_STEPS, BEGIN = 36, 12  # the middle window of 12 steps


def by_place():
    """Return recordings whose class is where in the middle window a burst of 4 steps lies."""
    spikes = np.zeros((18, N_STEPS, 4), np.uint8)
    for i, label in enumerate(LABEL):
        spikes[i, BEGIN + 4 * label : BEGIN + 4 * label + 4, 0] = 1
    return spikes


def by_channel():
    """Return recordings whose class is the channel that fires; force 3 swaps the channels of two classes."""
    spikes = np.zeros((18, N_STEPS, 4), np.uint8)
    for i, label in enumerate(LABEL):
        spikes[i, :, [1, 0, 2][label] if FORCE[i] == 3 else label] = 1
        spikes[i, :, 3] = FORCE[i] == 3
    return spikes


KNN = {"kind": "knn", "channels": "each", "window_ms": 20.0, "k": 1}


def written(folder, spikes, name="tiny", **changes):
    """Write recordings and a search space; keywords replace whole sections."""
    np.savez(
        folder / "x.npz",
        spikes=spikes,
        label=LABEL,
        force=FORCE,
        repetition=REPETITION,
        session=np.arange(18) % 2,
        hard=LABEL // 2,
    )
    space = {
        "study": name,
        "seed": 7,
        "data": {
            "kind": "raster",
            "file": "x.npz",
            "step_ms": 5.0,
            "columns": {"fabric": "label"}
            | {name: name for name in ("force", "repetition", "session", "hard")},
        },
        "task": {"target": "fabric"},
        "window": {"n_steps": 12},
        "split": {"train": {"repetition": 0}, "validation": {"repetition": 1}},
        "model": KNN,
        "objectives": ["accuracy:max"],
        **changes,
    }
    path = folder / f"{name}.yaml"
    path.write_text(yaml.safe_dump(space, sort_keys=False))
    return path


def run(folder, spikes, name="tiny", **changes):
    return explore.run(load_space(written(folder, spikes, name, **changes)), folder / "r", progress=False)


def row(study):
    return dict(study.trials.iloc[0])


def test_a_family_that_reads_the_place_falls_where_windows_move(tmp_path):
    # 4 steps later every burst is where the class before it was; that of class 0 is gone, and ties go to 0.
    # 4 steps earlier it is where the class after it was; that of class 2 is gone.
    study = run(tmp_path, by_place(), evaluation={"shifts": [4, -4]}, objectives=["accuracy_shifted:max"])
    columns = row(study)
    assert columns["accuracy"] == 1.0
    assert columns["accuracy_shifted"] == pytest.approx(1 / 6)
    assert columns["accuracy_shifted_min"] == 0.0
    assert (columns["accuracy_unshifted"], columns["n_shifted"]) == (1.0, 9)
    # Wilson of 1.5 and of 0 right answers of 9
    assert columns["accuracy_shifted_se"] == pytest.approx(np.sqrt(5 / 36 / 9 + 1 / 324) / (10 / 9))
    assert columns["accuracy_shifted_min_se"] == pytest.approx(1 / 18 / (10 / 9))
    [shifts] = study.arrays(0, "shifts.npz")
    assert shifts["shift"].tolist() == [4, -4] and shifts["accuracy"].tolist() == [1 / 3, 0.0]
    points = study.points()
    first = points[points["read_out_ms"] == 20.0].iloc[0]  # class 0 at the start, any other class is silent
    assert (first["accuracy"], first["accuracy_shifted"]) == (pytest.approx(2 / 3), pytest.approx(1 / 6))


def test_training_on_crops_holds_within_their_range(tmp_path):
    window = {"n_steps": 12, "jitter_steps": 4}
    training = {"crops": 3}  # 4 steps earlier, in place, 4 steps later
    study = run(tmp_path, by_place(), window=window, training=training, evaluation={"shifts": [0, 1]})
    assert row(study)["n_weights"] == 9 * 3 * 3 * 4
    assert row(study)["accuracy_shifted_min"] < 1.0  # the same burst is class 0 in one crop and 1 in another
    study = run(tmp_path, by_channel(), "rate", window=window, training=training, evaluation={"shifts": [12]})
    assert row(study)["accuracy_shifted"] == 1.0


def test_a_family_that_reads_rates_keeps_its_accuracy(tmp_path):
    columns = row(run(tmp_path, by_channel(), evaluation={"shifts": [-12, 12]}))
    assert (columns["accuracy_shifted"], columns["accuracy_shifted_min"]) == (1.0, 1.0)
    assert columns["accuracy_shifted_se"] == pytest.approx(0.05)  # Wilson of 9 of 9


def test_each_group_is_answered_without_its_recordings(tmp_path):
    study = run(tmp_path, by_channel(), evaluation={"leave_out": "force"}, objectives=["accuracy_unseen:max"])
    [record] = study.runs(0)
    assert record["unseen"] == {"force": {"1": 1.0, "2": 1.0, "3": pytest.approx(1 / 3)}}
    columns = row(study)
    assert columns["accuracy"] == 1.0
    assert columns["accuracy_unseen"] == columns["accuracy_unseen_force"] == pytest.approx(7 / 9)
    assert columns["accuracy_unseen_se"] == columns["accuracy_unseen_force_se"] == pytest.approx(2 / 9)
    best = dse.open(study.folder).skyline([("accuracy_unseen", "max"), ("n_weights", "min")]).rows
    assert best["accuracy_unseen"].tolist() == [pytest.approx(7 / 9)]
    points = study.points()  # the recordings do not change over time
    assert points["read_out_ms"].tolist()[1:] == [20.0, 40.0]
    for name in ("accuracy_unseen", "accuracy_unseen_force"):
        assert points[name].tolist() == [pytest.approx(7 / 9)] * 3


def test_signals_of_a_group_that_is_left_out_are_encoded_too(tmp_path):
    """Only the signals that a data set uses become spikes: those that it is tested on are among them."""
    path = written(tmp_path, by_channel().cumsum(axis=1), evaluation={"leave_out": "force"})
    space = yaml.safe_load(path.read_text())
    space["data"] |= {"kind": "time_series", "signal": "spikes"}
    space["encoder"] = {"kind": "send_on_delta", "thresholds": [1.0]}
    path.write_text(yaml.safe_dump(space))
    study = explore.run(load_space(path), tmp_path / "r", progress=False)
    [record] = study.runs(0)
    assert record["unseen"] == {"force": {"1": 1.0, "2": 1.0, "3": pytest.approx(1 / 3)}}


def test_decisions_have_their_own_accuracy_on_groups(tmp_path):
    decision = {"phi": [0, 2], "theta": [0.4, 0.6]}
    changes = {"training": FEW, "evaluation": HONEST, "search": {"repeats": 2}}
    study = run(tmp_path, by_channel(), model={"kind": "snn", "hidden": [5]}, decision=decision, **changes)
    points = study.points()
    assert points["accuracy_unseen"].notna().all() and points["accuracy_shifted"].notna().all()
    last = points[points["phi"].notna()]
    assert len(last) == 4 and (last["accuracy_unseen"] == last["accuracy_unseen_force"]).all()
    files = [study.arrays(0, name) for name in ("surface.npz", "read_out.npz")]
    for (first, second), rows in zip(
        files, (points["phi"].notna(), points["read_out_ms"].notna()), strict=True
    ):
        # Run 0 leaves out forces 1 and 3, run 1 force 2.
        folds = [first["unseen/0"].ravel(), first["unseen/1"].ravel(), second["unseen/0"].ravel()]
        expected = np.mean(folds, axis=0)[: rows.sum()]
        assert points.loc[rows, "accuracy_unseen"].tolist() == pytest.approx(expected.tolist())
    wide = run(tmp_path, by_channel(), "wide", model=SNN, decision={"phi": {"up_to": "outputs"}}, **changes)
    on_grid = wide.points()["phi"].notna()  # of each run its own: no fold knows it
    assert wide.points().loc[on_grid, "accuracy_unseen"].isna().all()
    assert wide.points().loc[~on_grid, "accuracy_unseen"].notna().all()


def test_folds_and_several_columns(tmp_path):
    leave_out = [{"column": "force", "folds": 2}, "session"]
    study = run(tmp_path, by_channel(), evaluation={"leave_out": leave_out})
    [record] = study.runs(0)
    unseen = record["unseen"]
    assert list(unseen) == ["force", "session"]
    assert sorted("|".join(unseen["force"]).split("|")) == ["1", "2", "3"] and len(unseen["force"]) == 2
    assert list(unseen["session"]) == ["0", "1"]
    means = [np.mean(list(unseen[name].values())) for name in unseen]
    errors = [np.std(list(unseen[name].values()), ddof=1) / np.sqrt(2) for name in unseen]
    assert row(study)["accuracy_unseen"] == pytest.approx(np.mean(means))
    assert row(study)["accuracy_unseen_se"] == pytest.approx(np.hypot(*errors) / 2)


def test_repeats_share_the_folds(tmp_path):
    study = run(
        tmp_path, by_channel(), evaluation={"leave_out": "force", "shifts": [1]}, search={"repeats": 2}
    )
    runs = study.runs(0)
    assert [list(record["unseen"]["force"]) for record in runs] == [["1", "3"], ["2"]]
    columns = row(study)
    assert columns["accuracy_unseen"] == pytest.approx(7 / 9)  # not the mean of 2/3 and 1
    assert columns["accuracy_unseen_se"] == pytest.approx(2 / 9)
    assert columns["accuracy_shifted_se"] == 0.0  # over the runs, which agree


SNN = {"kind": "snn", "hidden": {"choice": [[5], [8]]}, "input_delays": [0, 2]}
HONEST = {"shifts": [-2, 3], "leave_out": "force"}
FEW = {"epochs": 2, "batch_size": 4, "learning_rate": 0.05}


def unlike(frame, *columns):
    return frame.drop(columns=["train_s", *columns])


def test_a_spiking_network_is_the_same_alone_in_a_cohort_and_after_a_stop(tmp_path):
    rng = np.random.default_rng(3)
    spikes = (rng.random((18, N_STEPS, 4)) < 0.3 * by_channel() + 0.05).astype(np.uint8)
    changes = {"training": FEW, "evaluation": HONEST, "search": {"repeats": 2}}
    both = run(tmp_path, spikes, "both", model=SNN, **changes)
    assert set(both.trials["status"]) == {"finished"}
    alone = run(tmp_path, spikes, "alone", model={**SNN, "hidden": {"choice": [[8]]}}, **changes)
    expected = unlike(both.trials[1:].reset_index(drop=True), "trial")
    pd.testing.assert_frame_equal(
        unlike(alone.trials, "trial")[expected.columns], expected, check_dtype=False
    )

    before = both.trials
    store.run_file(both.folder, 1, 1).unlink()
    assert both.trials["trial"].tolist() == [0], "a trial that lacks a run is left out"
    again = run(tmp_path, spikes, "both", model=SNN, **changes)
    pd.testing.assert_frame_equal(unlike(again.trials), unlike(before), check_exact=True)

    plain = run(tmp_path, spikes, "plain", model=SNN, training=FEW, search={"repeats": 2})
    same = [name for name in plain.trials if name != "train_s"]
    pd.testing.assert_frame_equal(both.trials[same], plain.trials[same], check_exact=True)
    assert not [name for name in plain.trials if "shifted" in name or "unseen" in name]


def test_a_failure_without_a_group_names_it(tmp_path, monkeypatch):
    model = {"kind": "mlp", "window_ms": 20.0, "learning_rate": 1e30, "epochs": 5}
    with np.errstate(all="ignore"):
        study = run(tmp_path, by_channel(), model=model, evaluation={"leave_out": "force"})
    assert study.trials["reason"][0].startswith("RuntimeError: without force 1: ")


def test_a_run_that_fails_without_a_group_is_not_trained_further(tmp_path, monkeypatch):
    outcomes, sizes = jobs._outcomes, []

    def counted(job, *arguments, **keywords):
        sizes.append(len(job.runs))
        return outcomes(job, *arguments, **keywords)

    monkeypatch.setattr(jobs, "_outcomes", counted)
    training = FEW | {"learning_rate": {"choice": [0.05, 1e30]}}
    changes = {"model": SNN | {"hidden": 5, "arithmetic": "ideal"}, "evaluation": {"leave_out": "force"}}
    study = run(tmp_path, by_channel(), training=training, **changes)
    ours = study.trials.set_index("training.learning_rate")
    assert ours["status"].to_dict() == {0.05: "finished", 1e30: "failed"}
    assert str(ours["reason"][1e30]).startswith("TrainingDiverged: without force 1: ")
    assert sizes == [2] + [1] * (len(sizes) - 1) and len(sizes) > 2
    training = FEW | {"learning_rate": {"choice": [0.05]}}
    alone = run(tmp_path, by_channel(), "alone", training=training, **changes)
    assert alone.trials["accuracy_unseen"][0] == ours["accuracy_unseen"][0.05]


def test_what_is_worth_saying_about_shifts(tmp_path):
    spikes = by_channel()
    study = run(tmp_path, spikes, window={"n_steps": 12, "jitter_steps": 2}, evaluation={"shifts": [2, -3]})
    assert study.warnings == ["evaluation.shifts: -3 lie outside the training crops (window.jitter_steps: 2)"]


@pytest.mark.parametrize(
    ("changes", "line", "message"),
    [
        (
            {"evaluation": {"shifts": [13, -1]}},
            "- 13",
            "evaluation.shifts must all have room in some validation recording, got [13, -1]: windows can "
            "move by -12 to 12 steps at most",
        ),
        (
            {"evaluation": {"leave_out": "repetition"}},
            "leave_out",
            "evaluation.leave_out: column 'repetition' must have at least 2 values in validation, got 1",
        ),
        (
            {"evaluation": {"leave_out": {"column": "force", "folds": 4}}},
            "leave_out",
            "evaluation.leave_out: column 'force' must have at least 4 values in validation, got 3",
        ),
        (
            {"task": {"target": "force"}, "evaluation": {"leave_out": "fabric"}, "data": None},
            "leave_out",
            "evaluation.leave_out: without fabric 2 there is no training recording of class '2'",
        ),
    ],
)
def test_what_only_recordings_show_is_refused_before_any_training(
    tmp_path, monkeypatch, changes, line, message
):
    if changes.get("data", True) is None:  # fabric 2 is the only one of its force
        changes = {name: section for name, section in changes.items() if name != "data"}
        monkeypatch.setattr("tests.study.test_evaluation.FORCE", np.tile(np.repeat([0, 1, 2], 3), 2) // 2 + 1)
    path = written(tmp_path, by_channel(), **changes)
    monkeypatch.setattr(Training, "_planned", lambda *_: pytest.fail("nothing must be trained"))
    with pytest.raises(ConfigError) as caught:
        explore.run(load_space(path), tmp_path / "r", progress=False)
    [fault] = caught.value.faults
    assert fault.message == message
    assert line in path.read_text().splitlines()[fault.line - 1] or line == "- 13"
    assert fault.path == str(path)


@needs_papers
def test_every_family_is_evaluated(tmp_path):
    kinds = [
        {"kind": "snn", "hidden": [4]},
        {"kind": "threshold_lif", "weights": "learnt"},
        {"kind": "elm", "hidden": 8, "window_ms": 20.0, "windows": 3},
        {"kind": "hots", "layers": 1, "prototypes": 2, "radius": 1},
        {"kind": "naive_bayes", "window_ms": 20.0},
        {"kind": "mlp", "window_ms": 20.0, "hidden": 4, "epochs": 2},
        KNN,
    ]
    study = run(
        tmp_path,
        by_channel(),
        model={"choice": kinds},
        window={"n_steps": 12, "jitter_steps": 2},
        training={**FEW, "crops": 3},
        evaluation={"shifts": [3], "leave_out": "force"},
    )
    assert set(study.trials["status"]) == {"finished"}, study.trials["reason"].tolist()
    assert study.trials["family"].tolist() == [kind["kind"] for kind in kinds]
    # The recordings do not change over time, so moved windows are the same windows.
    assert study.trials["accuracy_shifted"].tolist() == study.trials["accuracy"].tolist()
    assert study.trials["accuracy_unseen"].between(0, 1).all()


@needs_papers
def test_a_joint_target_has_columns_for_each_head(tmp_path):
    models = {
        "choice": [
            {"kind": "snn", "hidden": [4]},
            {"kind": "cascade", "hidden": [4], "first_hidden": [4]},
            KNN,
        ]
    }
    study = run(
        tmp_path,
        by_channel(),
        task={"target": ["fabric", "hard"], "joint": True},
        model=models,
        training=FEW,
        evaluation={"shifts": [3], "leave_out": "force"},
    )
    assert set(study.trials["status"]) == {"finished"}, study.trials["reason"].tolist()
    points = study.points()
    full = points[points["read_out_ms"].isna() & points["phi"].isna()]
    assert full["task"].tolist() == ["fabric", "hard"] * 3
    assert full["accuracy_shifted"].tolist() == full["accuracy"].tolist()
    [knn] = study.runs(2)
    joint, heads = knn["unseen"]["force"], knn["of_heads"]
    for fold in ("1", "2", "3"):
        assert joint[fold] <= min(heads[name]["unseen"]["force"][fold] for name in ("fabric", "hard"))
