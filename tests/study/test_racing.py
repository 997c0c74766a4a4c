"""Racing: who stops, that nothing shows how often or on how many workers, and what is written down."""

import contextlib

import numpy as np
import pytest
from pandas.testing import assert_frame_equal

from dse import store
from dse.study import explore
from dse.study.as_optuna import as_optuna
from dse.study.ledger import read_entries
from dse.study.racing import saved
from dse.study.workers import Workers
from tests import tiny_study

WORKERS = True
RATES = [0.1, 0.2, 0.3, 0.4, 0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8, 0.9]


RACING = {"racing": {"rungs": [2, 5]}}


def space_of(folder, jobs=1, search=RACING, **changes):
    model = {"kind": "curve", "true_rate": {"choice": RATES}, "hidden": {"choice": [[8], [9]]}}
    changes = {"model": model, **changes}
    return tiny_study.make_space(
        folder,
        training={"epochs": 20},
        search={"sampler": "grid", **search},
        **{"objectives": ["accuracy:max", "n_weights:min"], "execution": {"jobs": jobs}, **changes},
    )


def in_process(_, function, jobs):
    """Do the work of workers in this process."""
    yield from ((job, part) for job in jobs for part in function(job))


@pytest.fixture(scope="module")
def raced(tmp_path_factory):
    folder = tmp_path_factory.mktemp("raced")
    return explore.run(space_of(folder, jobs=2), folder / "results", progress=False)


def assert_same(one, other):
    for a, b in ((one.trials, other.trials), (one.points(), other.points())):
        assert_frame_equal(a.drop(columns="train_s"), b.drop(columns="train_s"), check_exact=True)
    for path in (one.folder / "racing").glob("*.json"):
        assert store.read_json(path) == store.read_json(other.folder / "racing" / path.name)


def test_families_that_cannot_pause_train_to_their_ends(tmp_path, monkeypatch):
    monkeypatch.setattr(Workers, "stream", in_process)
    rates = {"true_rate": {"choice": RATES[4:]}, "hidden": [8]}
    both = {"choice": [{"kind": kind, **rates} for kind in ("curve", "together")]}
    of = {}
    for name, search in (("raced", RACING), ("whole", {})):
        folder = tmp_path / name
        folder.mkdir()
        space = space_of(folder, search=search, model=both)
        of[name] = explore.run(space, folder / "results", progress=False)
    trials = of["raced"].trials.set_index("trial")
    plain = trials["family"] == "together"
    assert set(trials["status"][plain]) == {"finished"} and plain.sum() == 8
    assert (trials["status"][~plain] == "stopped").sum() == 4
    others = ["train_s", *(f"accuracy_corrected{end}" for end in ("", "_low", "_high"))]  # by all points
    points = [study.points().query("family == 'together'").drop(columns=others) for study in of.values()]
    assert_frame_equal(*(x.reset_index(drop=True) for x in points), check_exact=True)


def test_a_rung_may_be_a_share_of_the_epochs(raced, tmp_path, monkeypatch):
    monkeypatch.setattr(Workers, "stream", in_process)
    space = space_of(tmp_path, search={"racing": {"rungs": [0.1, 0.25]}})  # of 20
    found = explore.run(space, tmp_path / "results", progress=False)
    assert_same(raced, found)


def test_one_in_three_goes_on_and_the_rest_is_as_without(raced, tmp_path, monkeypatch):
    trials = raced.trials.set_index("trial")
    stopped = trials[trials["status"] == "stopped"]
    # Of 24 designs 8 go on to the second rung, and 4 of these, two per objective, to the end.
    assert saved(raced.folder) == ["racing: 20 of 24 designs stopped early, which saves 72% of all epochs"]
    assert len(stopped) == 20 and (stopped["stopped_at_epoch"] == 2).sum() >= 14
    rounds = store.document(raced.folder, "racing/00000")
    assert [(one["epochs"], len(one["trials"])) for one in rounds] == [(2, 24), (5, 8), (None, 4)]
    # The best of the smaller networks is the whole front; nobody can stop it.
    best = trials.index[(trials["model.true_rate"] == 0.9) & (trials["n_weights"] == 56)]
    assert trials["status"][best].tolist() == ["finished"]
    for _, row in stopped.iterrows():
        right = round(row["model.true_rate"] * (1 - np.exp(-row["stopped_at_epoch"] / 2)) * 18) / 18
        assert row["accuracy_when_stopped"] == pytest.approx(right)
        of = "8 of 24" if row["stopped_at_epoch"] == 2 else "4 of 8"
        so_far = f"accuracy {right:.4g} after {row['stopped_at_epoch']} epochs"
        assert row["reason"] == f"{so_far}, not among the best {of} designs there"
    assert stopped["accuracy"].isna().all()
    assert not set(raced.points()["trial"]) & set(stopped.index)
    monkeypatch.setattr(Workers, "stream", in_process)
    full = explore.run(space_of(tmp_path, search={}), tmp_path / "results", progress=False)
    points = full.points()
    here = points[points["trial"].isin(raced.points()["trial"])].reset_index(drop=True)
    ends = ("", "_low", "_high")  # what a point is corrected by depends on all points
    others = ["train_s", *(f"accuracy_corrected{end}" for end in ends)]
    assert_frame_equal(here.drop(columns=others), raced.points().drop(columns=others))
    assert not list(raced.folder.glob("checkpoints/*"))


def test_optuna_has_the_intermediate_values(raced):
    loaded = as_optuna(raced.folder)
    entries = read_entries(raced.folder)
    states = [trial.state.name for trial in loaded.trials]
    assert states.count("PRUNED") >= 5 and set(states) == {"PRUNED", "COMPLETE"}
    assert all(entry.is_reported and entry.values is not None for entry in entries)
    for trial, entry in zip(loaded.trials, entries, strict=True):
        assert 2 in trial.intermediate_values
        if trial.state.name == "PRUNED":
            last = max(trial.intermediate_values)
            assert trial.intermediate_values[last] == entry.values[0]


@pytest.mark.parametrize("n_ends", [27, 34])
def test_who_stops_depends_neither_on_workers_nor_on_interruptions(raced, tmp_path, monkeypatch, n_ends):
    left = n_ends

    def interrupted(_):
        nonlocal left
        left -= 1
        if not left:
            raise KeyboardInterrupt

    monkeypatch.setattr(Workers, "stream", in_process)
    space = space_of(tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(explore._Tables, "refresh", interrupted)
        with pytest.raises(KeyboardInterrupt):
            explore.run(space, tmp_path / "results", progress=False)
    assert_same(explore.run(space, tmp_path / "results", progress=False), raced)


@pytest.mark.parametrize("n_ends", [27, 34])
def test_a_lost_document_of_a_race_is_written_anew(raced, tmp_path, monkeypatch, n_ends):
    monkeypatch.setattr(Workers, "stream", in_process)
    space, left = space_of(tmp_path), n_ends or 0

    def interrupted(_):
        nonlocal left
        left -= 1
        if not left:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch, contextlib.suppress(KeyboardInterrupt):
        patch.setattr(explore._Tables, "refresh", interrupted)
        explore.run(space, tmp_path / "results", progress=False)
    store.keep(tmp_path / "results" / "tiny", "racing/00000", None)
    study = explore.run(space, tmp_path / "results", progress=False)
    for one, other in ((study.trials, raced.trials), (study.points(), raced.points())):
        assert_frame_equal(one.drop(columns="train_s"), other.drop(columns="train_s"), check_exact=True)
    assert saved(study.folder) == saved(raced.folder)


def test_a_batch_competes_with_those_before_it(tmp_path, monkeypatch):
    monkeypatch.setattr(Workers, "stream", in_process)
    space = space_of(tmp_path, search={"racing": {"rungs": [2]}, "batch": 6})
    study = explore.run(space, tmp_path / "results", progress=False)
    going = [
        [len(one["trials"]) for one in store.document(study.folder, f"racing/{batch:05d}", [])]
        for batch in range(4)
    ]
    # Rates rise from batch to batch, first with 56 weights, then with 63: of 12 the best 4 are all new ones.
    assert going[:2] == [[6, 4], [6, 4]]
    reasons = study.trials.set_index("trial")["reason"]
    assert reasons[0].endswith("not among the best 4 of 6 designs there")
    assert "of 18 designs there" in reasons[12] and "of 24 designs there" in reasons[18]
