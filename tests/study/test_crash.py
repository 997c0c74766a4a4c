"""A study that is killed, stopped or out of disk: the same command goes on and ends with the same tables."""

import glob
import multiprocessing
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest
from pandas.testing import assert_frame_equal

from dse import store
from dse.study import results, workers
from tests import tiny_study
from tests.in_process import InProcess
from tests.waiting import PATIENCE_S, until

ROOT = Path(__file__).resolve().parents[2]
CHILDREN = multiprocessing.get_context("forkserver")
LAZY = ("optuna", "optuna.storages.journal", "pyarrow.parquet", "scipy.stats", "numba", "moocore")
"""What a study imports only when it needs it."""
N_RUNS = 8
"""Six designs, of which the front gets a second repeat; at least this many runs in all."""


def prepare(folder, jobs=1):
    folder.mkdir()
    model = {**tiny_study.plain()["model"], "seconds": 0.02}
    search = {"sampler": "grid", "batch": 4, "repeats_on_front": 2}
    tiny_study.make_space(folder, model=model, search=search, execution={"jobs": jobs})
    return folder


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = prepare(tmp_path_factory.mktemp("crash") / "whole")
    assert tiny_study.run_folder(str(folder)) == 0
    return results.open(folder / "results" / "tiny")


def study_process(folder, limit, told, cache, executor):
    """Run the study of a folder, with an executor instead of loky; write what it says to a file."""
    os.environ["DSE_CACHE"] = cache
    if executor is not None:
        workers.Loky = executor
    os.dup2(os.open(told, os.O_WRONLY | os.O_CREAT), 2)
    if limit is not None:  # the largest file that the process may write
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
    sys.exit(tiny_study.run_folder(str(folder)))


def start(folder, limit=None, executor=InProcess):
    """Start a process that runs a study: a fork of one that has imported everything."""
    CHILDREN.set_forkserver_preload([__name__, *LAZY])
    cache = os.environ["DSE_CACHE"]  # those of the server are older
    arguments = folder, limit, folder / "told", cache, executor
    process = CHILDREN.Process(target=study_process, args=arguments)
    process.start()
    return process


def killed(process):
    process.kill()
    process.join()


def finished_runs(folder):
    records = (folder / "results" / "tiny" / "runs").glob("*.npz")
    return {str(path): (path.stat().st_ino, path.stat().st_mtime_ns) for path in records}


def wait_until(process, condition):
    until(lambda: process.exitcode is not None or condition(), "the study to come so far")


def assert_same(folder, whole):
    found = results.open(folder / "results" / "tiny")
    for one, other in ((found.trials, whole.trials), (found.points(), whole.points())):
        one, other = (frame.drop(columns="train_s") for frame in (one, other))
        assert_frame_equal(one, other, check_exact=True)


def test_kill_9_within_a_cohort_loses_what_was_unfinished(tmp_path):
    gate = tmp_path / "gate"
    model = {**tiny_study.plain()["model"], "kind": "together", "gate": str(gate)}
    folders = [tmp_path / name for name in ("whole", "killed")]
    for folder in folders:
        folder.mkdir()
        tiny_study.make_space(folder, model=model, search={"sampler": "grid"}, execution={"jobs": 1})
    process = start(folders[1])
    wait_until(process, lambda: len(finished_runs(folders[1])) >= 2)
    killed(process)
    kept = finished_runs(folders[1])
    assert 2 <= len(kept) < 6
    gate.touch()
    for folder in folders:
        assert tiny_study.run_folder(str(folder)) == 0
    assert kept.items() <= finished_runs(folders[1]).items()
    assert_same(folders[1], results.open(folders[0] / "results" / "tiny"))
    assert not list((folders[1] / "results").rglob(".writing-*"))
    runs = (folders[1] / "results" / "tiny" / "runs").glob("*.npz")
    members = [int(store.load_arrays(run / "history.npz")["members"]) for run in runs]
    assert sorted(members) == sorted([6] * len(kept) + [6 - len(kept)] * (6 - len(kept)))


def test_ctrl_c_stops_cleanly_and_the_same_command_goes_on(tmp_path, whole):
    folder = prepare(tmp_path / "stopped")
    code = f"import sys; from tests.tiny_study import run_folder; sys.exit(run_folder({str(folder)!r}))"
    process = subprocess.Popen(
        [sys.executable, "-c", code], cwd=ROOT, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    until(lambda: process.poll() is not None or len(finished_runs(folder)) >= 2, "two finished runs")
    os.killpg(process.pid, signal.SIGINT)
    _, told = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130
    assert told == ""
    stopped = finished_runs(folder)
    table = pd.read_parquet(folder / "results" / "tiny" / "trials.parquet")
    assert table["repeats"].sum() == len(stopped)
    time.sleep(0.3)
    assert finished_runs(folder) == stopped, "a worker went on after its parent"
    assert tiny_study.run_folder(str(folder)) == 0
    assert stopped.items() <= finished_runs(folder).items()
    assert_same(folder, whole)


def test_semaphores_of_a_killed_group_are_removed_by_the_next_run(tmp_path):
    tiny_study.write_recordings(tmp_path / "tiny.npz")
    model = {**tiny_study.plain()["model"], "gate": str(tmp_path / "gate"), "hidden": [4]}
    tiny_study.make_space(tmp_path, model=model, execution={"jobs": 1})
    code = f"import sys; from tests.tiny_study import run_folder; sys.exit(run_folder({str(tmp_path)!r}))"
    process = subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, start_new_session=True)
    name = f"/dev/shm/sem.loky-{process.pid}-"
    results_folder = tmp_path / "results" / "tiny"
    until(lambda: process.poll() is not None or glob.glob(f"{name}*"), "semaphores")
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    if not glob.glob(f"{name}*"):
        pytest.skip("this system keeps them elsewhere, or removes them")
    (tmp_path / "gate").touch()
    assert tiny_study.run_folder(str(tmp_path)) == 0
    assert results.open(results_folder).trials["status"].eq("finished").all()
    assert not glob.glob(f"{name}*")


@pytest.mark.parametrize("limit", [4_000, 60_000])
def test_a_full_disk_stops_the_study_and_fails_no_design(tmp_path, whole, monkeypatch, limit):
    """The book takes 49 kB from the beginning, the larger table more than 60."""
    monkeypatch.setenv("DSE_CACHE", str(tmp_path / "cache"))
    folder = prepare(tmp_path / "full")
    process = start(folder, limit=limit)
    process.join(PATIENCE_S)
    told = (folder / "told").read_text()
    assert process.exitcode == 2, told
    assert told.count("\n") == 1 and "; free some space and run the same command again" in told
    stopped = finished_runs(folder)
    assert tiny_study.run_folder(str(folder)) == 0
    assert stopped.items() <= finished_runs(folder).items()
    assert_same(folder, whole)


def test_kill_9_while_data_are_prepared(tmp_path, whole, monkeypatch):
    monkeypatch.setenv("DSE_CACHE", str(tmp_path / "cache"))
    folder = prepare(tmp_path / "killed")
    process = start(folder)
    wait_until(process, lambda: any((tmp_path / "cache").glob(".writing-*")))
    killed(process)
    assert tiny_study.run_folder(str(folder)) == 0
    assert not list((tmp_path / "cache").glob(".writing-*"))
    assert_same(folder, whole)
