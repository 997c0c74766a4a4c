"""Jobs that are killed or pause: what they go on from, and that nothing shows it afterwards."""

import numpy as np
import pytest

from dse import store
from dse.config.space import DecisionGrid
from dse.measure.objectives import need_no_decisions
from dse.models.snn.family import SNN
from dse.models.training import Training
from dse.study import checkpoints, jobs
from dse.study.record import load_record
from tests.models.snn.toy import toy
from tests.saved_data import save
from tests.spaces import design_of

EPOCHS = 6


class Killed(BaseException):
    """As if the process were gone."""


def cohort(folder, until=None, checkpoint_s=0.0, points_at_rung=False, **training):
    """Return a job of two runs whose data set is saved."""
    if not (folder / "data").exists():
        save(toy(n_channels=6, n_steps=20, n=24), folder / "data")
    runs = [
        jobs.Run(
            trial=number,
            repeat=0,
            design={"number": number},
            seed=1,
            sections=design_of(SNN(hidden=(5 + number,)), Training(epochs=EPOCHS, batch_size=9, **training)),
            data=folder / "data",
            base=folder,
            folder=store.run_file(folder / "study", number, 0),
            decision=DecisionGrid(np.array([0, 4]), np.array([0.5, 0.9])),
            hardware=(),
        )
        for number in range(2)
    ]
    return jobs.TrainingJob(
        tuple(runs), until=until, checkpoint_s=checkpoint_s, points_at_rung=points_at_rung
    )


def trained(job):
    assert sorted(jobs.train(job)) == [(0, None), (1, None)]


def files(folder):
    """Return every array and number of the finished runs, without times."""
    found = {}
    for number in range(2):
        run = store.run_file(folder / "study", number, 0)
        record = load_record(run)
        columns = {k: x for k, x in record.measured.columns.items() if k != "train_s"}
        found[f"{number}"] = columns
        found |= {f"{number}/{k}": x for k, x in store.load_arrays(run).items()}
    return found


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    trained(cohort(folder, checkpoint_s=1e9))
    return files(folder)


def assert_ended_as(folder, whole):
    np.testing.assert_equal(files(folder), whole)
    assert not list((folder / "study" / "checkpoints").glob("*/runs/*.npz"))


@pytest.fixture
def saved(monkeypatch):
    """Return the (trial, epochs) of every checkpoint that is written; a kill comes after the seventh."""
    written = []
    save_plain = checkpoints.save

    def save_and_die(study, epochs, training, record, *rest):
        save_plain(study, epochs, training, record, *rest)
        written.append((record["trial"], epochs))
        if len(written) == 7:
            raise Killed

    monkeypatch.setattr(checkpoints, "save", save_and_die)
    return written


def test_a_killed_job_repeats_what_followed_its_checkpoints(tmp_path, whole, saved):
    with pytest.raises(Killed):
        list(jobs.train(cohort(tmp_path)))
    # Of the fourth epoch there is a checkpoint of the first run alone: now they stand at different epochs.
    assert saved == [(k, n) for n in (1, 2, 3) for k in (0, 1)] + [(0, 4)]
    assert list(checkpoints.folders(tmp_path / "study", 0, 0)) == [4]
    saved.clear()
    trained(cohort(tmp_path))
    assert saved == [(1, 4), (1, 5), (0, 5)]
    assert_ended_as(tmp_path, whole)


def test_jobs_from_rung_to_rung_end_as_one_and_measure_on_the_way(tmp_path, whole):
    study, measured = tmp_path / "study", {}
    for until, points in ((2, True), (3, False)):
        trained(cohort(tmp_path, until, points_at_rung=points))
        assert not any(store.run_file(study, k, 0).exists() for k in (0, 1))
        record = checkpoints.at_rung(study, 1, 0, until)
        assert record is not None and not record.failed
        assert record.files == ("state.npz",)
        assert checkpoints.at_rung(study, 1, 0, until - 1) is None
        measured[until] = record.measured.columns["accuracy"]
    trained(cohort(tmp_path, until=3))  # nobody trains further than the rung
    trained(cohort(tmp_path))
    record = load_record(store.run_file(study, 1, 0))
    assert {n: x.columns["accuracy"] for n, x in record.rungs.items()} == measured
    assert_ended_as(tmp_path, whole)


def test_a_rung_without_points_lacks_only_what_the_decision_maker_measures(tmp_path):
    columns = []
    for points in (True, False):
        folder = tmp_path / str(points)
        folder.mkdir()
        trained(cohort(folder, until=2, points_at_rung=points))
        record = checkpoints.at_rung(folder / "study", 1, 0, 2)
        columns.append({k: x for k, x in record.measured.columns.items() if k != "train_s"})
    with_points, without = columns
    assert without.items() <= with_points.items() and need_no_decisions(
        ["accuracy", "n_weights", "energy_uj"]
    )
    lacking = with_points.keys() - without.keys()
    assert "t_p_ms" in lacking and not any(need_no_decisions([name]) for name in lacking)


@pytest.mark.parametrize("what", ["damaged", "other training", "other schema"])
def test_a_checkpoint_that_cannot_be_used_is_removed(tmp_path, whole, what, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(checkpoints, "SCHEMA", 0 if what == "other schema" else checkpoints.SCHEMA)
        other = {"learning_rate": 0.5} if what == "other training" else {}
        trained(cohort(tmp_path, until=2, **other))
    for folder in [*checkpoints.folders(tmp_path / "study", 0, 0).values()] if what == "damaged" else []:
        folder.write_bytes(folder.read_bytes()[:-100])
    trained(cohort(tmp_path))
    assert_ended_as(tmp_path, whole)
