"""Several processes that run one study: no design is trained by two, and nothing is lost."""

import contextlib
import multiprocessing
import os
import sys

import pandas as pd
import pytest
from pandas.testing import assert_frame_equal

from dse import store
from dse.config import ConfigError, load_space
from dse.study import claim, doctor, explore, workers
from dse.study.ledger import read_entries
from tests import tiny_study
from tests.in_process import InProcess
from tests.waiting import until

CHILDREN = multiprocessing.get_context("forkserver")


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    tiny_study.register()
    monkeypatch.setattr(workers, "Loky", InProcess)
    monkeypatch.setattr("dse.study.training._GLANCE_S", 0.05)


def space_of(folder, **changes):
    search = {"sampler": "grid", "batch": 2, **changes.pop("search", {})}
    return tiny_study.make_space(folder, search=search, execution={"jobs": 1}, **changes)


def table(results, name):
    return pd.read_parquet(results / "tiny" / name).drop(columns="train_s", errors="ignore")


def assert_same(one, other):
    for name in ("trials.parquet", "points.parquet"):
        assert_frame_equal(table(one, name), table(other, name), check_exact=True)
    designs = [
        [(x.trial, x.batch, x.design, x.values) for x in read_entries(of / "tiny")] for of in (one, other)
    ]
    assert designs[0] == designs[1]


def coordinator(folder, results):
    """Run a coordinator in a process of its own."""
    tiny_study.register()
    workers.Loky = InProcess
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    explore.run(load_space(folder / "tiny.yaml"), folder / results, progress=False)
    sys.exit(0)


@pytest.mark.parametrize("search", [{}, {"sampler": "tpe", "n_trials": 5, "repeats_on_front": 2}])
def test_two_coordinators_make_the_tables_of_one(tmp_path, search):
    space, trained = space_of(tmp_path, search=search), {"first": 0, "other": 0}
    explore.run(space, tmp_path / "alone", progress=False)

    def count(who):
        trained[who] += 1

    def first(_):
        count("first")
        if trained["first"] == 1:  # in the middle of its first batch
            explore.run(space, tmp_path / "shared", progress=False, on_trial=lambda _: count("other"))

    explore.run(space, tmp_path / "shared", progress=False, on_trial=first)
    assert trained["other"] >= 4
    assert_same(tmp_path / "shared", tmp_path / "alone")
    assert doctor.examine(tmp_path / "shared" / "tiny") == []
    assert not list((tmp_path / "shared" / "tiny" / store.COORDINATORS).glob("*"))


def test_what_a_killed_coordinator_leaves_is_trained_by_another(tmp_path):
    gate = tmp_path / "gate"
    slow = {**tiny_study.plain()["model"], "gate": str(gate), "hidden": {"choice": [[8], [4], [16]]}}
    space = space_of(tmp_path, model=slow, search={"batch": 4})
    process = CHILDREN.Process(target=coordinator, args=(tmp_path, "shared"))
    process.start()
    folder = tmp_path / "shared" / "tiny"
    until(lambda: process.exitcode is not None or len(store.runs_in(folder)) == 2, "two runs")
    other = CHILDREN.Process(target=coordinator, args=(tmp_path, "shared"))
    other.start()  # it trains what the first one has not begun, and waits for what it has
    until(lambda: other.exitcode is not None or len(store.living(folder)) == 2, "the other one")
    with pytest.raises(store.InUse):
        doctor.repair(folder)
    ended = {path: path.stat().st_ino for path in folder.glob("runs/*.npz")}
    process.kill()
    process.join()
    gate.touch()
    other.join()
    assert other.exitcode == 0
    explore.run(space, tmp_path / "alone", progress=False)
    assert_same(tmp_path / "shared", tmp_path / "alone")
    assert all(path.stat().st_ino == inode for path, inode in ended.items()), "a run was made twice"


def test_a_claim_holds_while_its_coordinator_lives(tmp_path):
    with contextlib.ExitStack() as of_both:
        one = claim.Coordinator(tmp_path, of_both)
        book = of_both.enter_context(store.Book(tmp_path, writes=True))
        one.begin(book)
        with contextlib.ExitStack() as of_other:
            other = claim.Coordinator(tmp_path, of_other)
            other.begin(of_other.enter_context(store.Book(tmp_path, writes=True)))
            assert (one.is_first, one.leads, other.is_first, other.leads) == (True, True, False, False)
            assert one.claim([(0, 0), (1, 0)], set()) == {(0, 0), (1, 0)}
            assert other.claim([(1, 0), (2, 0)], set()) == {(2, 0)}
            assert one.unclaimed([(1, 0), (2, 0), (3, 0)]) == [(1, 0), (3, 0)]
            assert one.claim([(3, 0)], {(1, 0)}) == {(3, 0)}, "0 has ended"
            assert other.unclaimed([(0, 0), (1, 0), (3, 0)]) == [(0, 0)]
        assert one.unclaimed([(2, 0)]) == [(2, 0)], "who has ended claims nothing"
        one.free()
        assert book.rows("claim", "coordinator = ?", one._name) == []


def test_who_may_not_join(tmp_path):
    search = {"racing": {"rungs": [1]}}
    plain = space_of(tmp_path)
    curve = {"model": {"kind": "curve"}, "training": {"epochs": 4}}

    def refused(what, **changes):
        def join(_):
            with pytest.raises(ConfigError, match=what):
                explore.run(space_of(tmp_path, **changes), tmp_path / what[:4], progress=False)

        begun = plain if "racing" not in what else space_of(tmp_path, **changes)
        explore.run(begun, tmp_path / what[:4], progress=False, on_trial=join)

    refused("seed is 8, but 7 in the study that runs", seed=8)
    refused("racing: .* runs, and its designs race", search=search, **curve)
