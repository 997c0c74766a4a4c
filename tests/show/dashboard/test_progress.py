"""How a study goes, from folders made by hand with known times, and from one that was really run."""

import fcntl
import json
import os
import shutil
import threading
from dataclasses import replace
from datetime import UTC, datetime

import pandas as pd
import pytest
import yaml

from dse import store
from dse.show.dashboard.progress import MAX_LISTED, gather_progress
from dse.store import StoreError, exclusive, is_held
from dse.study import explore
from dse.study.ledger import Entry, read_entries
from dse.study.status import status
from tests import tiny_study

START = 1_700_000_000.0


def moment(seconds):
    return datetime.fromtimestamp(START + seconds, UTC).isoformat()


class Folder:
    """A study's folder; times are in seconds after its start."""

    def __init__(self, path, *, sessions=(0,), **search):
        self.path, self.n = path, 0
        path.mkdir(parents=True)
        wanted = {"sampler": "random", "n_trials": 4, "batch": 2, "repeats": 1, "repeats_on_front": 1}
        space = {"study": "made", "objectives": ["accuracy:max", "energy_uj:min"], "search": wanted | search}
        (path / "search_space.yaml").write_text(yaml.safe_dump(space))
        store.keep(path, store.ENVIRONMENT, [{"started": moment(at)} for at in sessions])

    def ask(self, batch, *trials, at):
        for trial in trials:
            assert trial == self.n
            self.n += 1
            self.put(Entry(trial, batch, {"model.hidden": [8, trial], "rate": float("nan")}, START + at))

    def put(self, entry):
        with store.Book(self.path, writes=True) as book:
            book.put("trial", [entry.row()])

    def tell(self, *trials, at):
        for trial in trials:
            self.put(replace(read_entries(self.path)[trial], reported_s=START + at))

    def end(self, trial, repeat=0, *, at, status="finished", reason=""):
        path = store.run_file(self.path, trial, repeat)
        store.save_run(path, {"trial": trial, "repeat": repeat, "status": status, "reason": reason}, {})
        os.utime(path, (START + at, START + at))

    def table(self, trials, points=()):
        named = pd.DataFrame(trials, columns=["trial", "status", "reason", "repeats"])
        named.to_parquet(self.path / "trials.parquet")
        rows = pd.DataFrame(points, columns=["trial", "accuracy", "energy_uj"])
        rows.assign(task="texture", family="snn").to_parquet(self.path / "points.parquet")

    @property
    def found(self):
        return gather_progress(self.path)


def counts(total, done, running=0, failed=0, stopped=0):
    return {"total": total, "done": done, "running": running, "failed": failed, "stopped": stopped}


@pytest.fixture
def half(tmp_path):
    """A study of four trials: two finished, one failed, one under way."""
    made = Folder(tmp_path / "made")
    made.ask(0, 0, 1, at=60)
    made.end(0, at=600)
    made.end(1, at=900)
    made.tell(0, 1, at=901)
    made.ask(1, 2, 3, at=902)
    made.end(2, at=1800, status="failed", reason="loss is not finite")
    finished = [(0, "finished", "", 1), (1, "finished", "", 1)]
    made.table(finished, [(0, 0.0, 0.0), (1, 0.5, 5.0), (9, 1.0, 10.0)])
    return made


def test_a_study_half_way(half):
    (half.path / ".lock").touch()
    before = {path: (path.stat().st_mtime_ns, path.stat().st_size) for path in half.path.rglob("*")}
    found = half.found
    assert {p: (p.stat().st_mtime_ns, p.stat().st_size) for p in half.path.rglob("*")} == before
    assert (found["trials"], found["runs"]) == (counts(4, 3, running=1, failed=1), {"total": 4, "done": 3})
    assert found["running"] == [{"trial": 3, "design": {"model.hidden": [8, 3], "rate": None}}]
    assert found["failed"] == [{"reason": "loss is not finite", "count": 1, "trials": [2]}]
    assert (found["hours"], found["sign"], found["is_running"]) == (0.5, moment(1800), False)
    assert found["time_left_s"] is None  # three runs are too few to tell
    (end,) = found["hypervolume"]
    assert end == {"task": "texture", "hardware": "", "hypervolume": 0.25, "trials": 3, "hours": 0.5}
    trials, hours = (trace["x"] for trace in found["figure"]["data"])
    assert trials == [1, 2, 3] and hours == pytest.approx([1 / 6, 0.25, 0.5])
    assert "template" not in found["figure"]["layout"]
    json.dumps(found, allow_nan=False)
    now = status(half.path)
    assert (now.n_trials, now.n_done, now.n_runs, now.n_runs_done) == (4, 3, 4, 3)
    assert [(entry.trial, entry.batch, entry.proposed_s - START) for entry in now.running] == [(3, 1, 902)]
    assert now.trials_by_reason("failed") == [("loss is not finite", [2])]
    assert now.outcomes[0].status == "finished" and now.sign_s == START + 1800
    half.table([(0, "finished", "", 1), (1, "stopped", "behind the median", 1)])
    assert half.found["trials"] == counts(4, 3, running=1, failed=1, stopped=1)
    assert half.found["stopped"] == [{"reason": "behind the median", "count": 1, "trials": [1]}]


def test_a_process_that_holds_the_study_runs_it_and_who_looks_is_in_nobody_s_way(half):
    with exclusive(half.path):
        assert half.found["is_running"] is True
        with pytest.raises(StoreError, match="another process"), exclusive(half.path):
            pass
    assert half.found["is_running"] is False
    with (half.path / ".lock").open() as looked:
        fcntl.flock(looked, fcntl.LOCK_SH)
        threading.Timer(0.02, fcntl.flock, [looked, fcntl.LOCK_UN]).start()
        with exclusive(half.path):
            assert is_held(half.path)


def test_what_is_damaged_or_missing_takes_no_more_than_it_tells(half):
    for name in ("trials", "points"):
        path = half.path / f"{name}.parquet"
        path.write_bytes(path.read_bytes()[:-20])
        assert half.found["trials"]["done"] == 3
        path.unlink()
    found = half.found
    assert found["trials"] == counts(4, 3, running=1, failed=1)
    assert (found["figure"], found["hypervolume"]) == (None, [])
    (half.path / store.BOOK).write_bytes(b"torn")
    assert half.found["trials"]["done"] == 3
    shutil.rmtree(half.path / "runs")
    (half.path / store.BOOK).unlink()
    found = half.found
    assert found["trials"] == counts(4, 0)
    assert (found["hours"], found["time_left_s"], found["sign"]) == (0, None, None)


@pytest.mark.parametrize("space", ["", "objectives: ['accuracy:max']\nsearch: {batch: 2, repeats: 1}\n"])
def test_no_study_is_an_error(tmp_path, space):
    """A search space as a user writes it is not a study's either."""
    if space:
        (tmp_path / "search_space.yaml").write_text(space)
    with pytest.raises(StoreError, match=r"search_space\.yaml"):
        gather_progress(tmp_path)


def test_time_between_sessions_does_not_count(tmp_path):
    made = Folder(tmp_path / "made", sessions=(0, 100_000))
    made.ask(0, 0, 1, at=0)
    made.end(0, at=3600)
    made.end(1, at=101_000)
    made.tell(0, 1, at=101_000)
    made.ask(1, 2, 3, at=101_000)
    made.end(2, at=101_800)
    made.table([(k, "finished", "", 1) for k in range(3)], [(0, 0.0, 0.0), (1, 0.5, 5.0), (2, 1.0, 10.0)])
    assert made.found["hours"] == pytest.approx(1.5)
    assert made.found["time_left_s"] is None  # two runs of the second session are too few to tell
    assert made.found["figure"]["data"][1]["x"] == pytest.approx([1, 1 + 1000 / 3600, 1.5])


def test_a_copied_folder_falls_back_on_the_book_and_one_without_runs_keeps_its_numbers(tmp_path, half):
    made = Folder(tmp_path / "copied", n_trials=2, repeats_on_front=2)
    made.ask(0, 0, 1, at=0)
    for trial, repeat in ((0, 0), (0, 1), (1, 0)):
        made.end(trial, repeat, at=9_000_000)
    made.tell(0, 1, at=1800)
    assert (made.found["hours"], made.found["sign"]) == (0.5, moment(1800))
    half.end(3, at=1900)
    half.tell(2, 3, at=1900)
    half.table([(k, "finished", "", 1) for k in range(4)], [(0, 0.0, 0.0), (1, 0.5, 5.0), (2, 1.0, 10.0)])
    shutil.rmtree(half.path / "runs")
    found = half.found
    assert (found["trials"]["done"], found["runs"]) == (4, {"total": 4, "done": 4})
    assert found["time_left_s"] is None
    assert found["hypervolume"][0]["hours"] == pytest.approx(1900 / 3600)
    (half.path / store.BOOK).unlink()
    (end,) = half.found["hypervolume"]
    assert (end["trials"], end["hours"]) == (4, None)


def test_repeats_make_a_trial_done_and_the_front_needs_more(tmp_path):
    made = Folder(tmp_path / "made", n_trials=3, batch=3, repeats=2, repeats_on_front=4)
    made.ask(0, 0, 1, 2, at=0)
    for trial, repeat in ((0, 0), (0, 1), (1, 0), (1, 1), (2, 0)):
        made.end(trial, repeat, at=100 * (1 + trial) + repeat)
    # Trial 1 beats trial 0; trial 2 lacks a run of its own.
    made.table([(k, "finished", "", 2) for k in range(2)], [(0, 0.5, 5.0), (1, 0.6, 4.0)])
    assert made.found["trials"] == counts(3, 2, running=1)
    assert made.found["runs"] == {"total": 5 + 1 + 2, "done": 5}
    assert made.found["time_left_s"] is None


def test_the_time_left_is_that_of_the_missing_runs_at_the_pace_of_the_last_session(tmp_path):
    search = {"n_trials": 14, "batch": 7, "repeats": 2, "repeats_on_front": 4}
    made = Folder(tmp_path / "made", sessions=(0, 100_000), **search)
    made.ask(0, *range(7), at=0)
    for trial in range(4):
        made.end(trial, 0, at=10 * (1 + trial))
    later = [(0, 1), (1, 1), (2, 1), (3, 1), (4, 0), (4, 1), (5, 0), (5, 1), (6, 0)]
    for place, (trial, repeat) in enumerate(later, 1):
        made.end(trial, repeat, at=100_000 + 300 * place)
    made.table([(k, "finished", "", 2) for k in range(2)], [(0, 0.5, 5.0), (1, 0.6, 4.0)])
    assert made.found["runs"] == {"total": 28 + 2, "done": 13}
    assert made.found["time_left_s"] == pytest.approx(300 * 17)


def test_reasons_come_by_their_number_and_lists_end(tmp_path):
    n = MAX_LISTED + 10
    made = Folder(tmp_path / "made", n_trials=n, batch=n)
    made.ask(0, *range(n), at=0)
    assert made.found["trials"]["running"] == n
    assert [one["trial"] for one in made.found["running"]] == list(range(MAX_LISTED))
    for trial in range(n):
        made.end(trial, at=10 + trial, status="failed", reason="rare" if trial == 3 else "<b>often</b>")
    made.table([(k, "failed", "rare" if k == 3 else "<b>often</b>", 1) for k in range(n)])
    found = made.found
    assert found["trials"] == counts(n, n, failed=n)
    often, rare = found["failed"]
    assert (often["reason"], often["count"], often["trials"][:4]) == ("<b>often</b>", n - 1, [0, 1, 2, 4])
    assert len(often["trials"]) == MAX_LISTED
    assert rare == {"reason": "rare", "count": 1, "trials": [3]}
    assert (found["figure"], found["time_left_s"]) == (None, None)


def test_a_sampler_that_has_no_other_designs_ends_the_search(tmp_path):
    made = Folder(tmp_path / "made", n_trials=100, batch=3)
    made.ask(0, 0, 1, 2, at=0)
    made.tell(0, 1, 2, at=5)
    assert made.found["trials"]["total"] == 100
    made.ask(1, 3, at=6)
    assert made.found["trials"]["total"] == 100
    made.tell(3, at=7)
    assert made.found["trials"]["total"] == 4


def test_a_study_that_was_really_run(tmp_path):
    tiny_study.register()
    moods = {"kind": "fake", "hidden": {"choice": [[4], [8]]}, "mood": {"choice": ["fine", "raise"]}}
    space = tiny_study.make_space(tmp_path, model=moods, execution={"jobs": 1})
    ran = explore.run(space, tmp_path / "results", progress=False)
    found = gather_progress(ran.folder)
    assert (found["trials"], found["runs"]) == (counts(4, 4, failed=2), {"total": 4, "done": 4})
    (group,) = found["failed"]
    assert group["count"] == 2 and "hidden must be kind" in group["reason"]
    assert found["time_left_s"] is None and 0 < found["hours"] < 1
    (end,) = found["hypervolume"]
    assert (end["hardware"], end["trials"]) == ("loihi1_silicon", 4)
    assert 0 < end["hours"] <= found["hours"]
