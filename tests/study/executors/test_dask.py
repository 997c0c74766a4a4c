"""Jobs on a Dask cluster: results, lost workers, a lost scheduler, and clusters that cannot be used."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from dse.cli.command_line import main
from dse.config import ConfigError, load_space
from dse.store import StoreError
from dse.study import explore, results
from dse.study.executors import dask as on_dask
from dse.study.executors.dask import Dask, Unusable
from dse.study.executors.work import Failure
from dse.study.workers import Workers
from tests import tiny_study
from tests.study.test_crash import assert_same, finished_runs
from tests.waiting import until

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="module")
def workers():
    """Two workers of a cluster of ours, which end with it."""
    with Workers(2, Dask(2, None, None)) as started:
        yield started
        client = started._executor._client
        until(lambda: len(client.run(os.getpid)) == 2, "a lost worker to be there again")
        processes = list(client.run(os.getpid).values())
    until(lambda: not any(map(lives, processes)), "the workers to end")


def lives(process):
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True


def parts(job):
    yield f"begin {job}"
    if job == "raise":
        raise ValueError("phi must be at least 0")
    if job == "memory":
        raise MemoryError
    if job == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    print("a library's chatter")
    yield job.upper()


def test_every_job_comes_back_and_a_lost_worker_costs_its_own(workers, capfd):
    found = {}
    for job, part in workers.stream(parts, ["a", "killed", "raise", "b", "memory", "c"]):
        found.setdefault(job, []).append(part)
    assert {job: found[job] for job in "abc"} == {job: [f"begin {job}", job.upper()] for job in "abc"}
    raised, memory, killed = (found[name][-1] for name in ("raise", "memory", "killed"))
    assert isinstance(raised, Failure) and raised.reason == "ValueError: phi must be at least 0"
    assert not raised.by_machine and memory.by_machine and killed.by_machine
    assert killed.reason.startswith("worker died: Dask lost tcp://127.0.0.1:")
    assert capfd.readouterr().out == ""


def test_a_worker_that_does_not_fit_is_one_line(workers, monkeypatch):
    executor = workers._executor
    with pytest.raises(Unusable, match=r"^the Dask worker tcp://\S+ does not see /nowhere; all"):
        executor._check([Path("/nowhere")])
    about = on_dask._of_this_process()
    monkeypatch.setattr(on_dask, "_of_this_process", lambda: about | {"dse": "0.0.9"})
    with pytest.raises(Unusable, match=r"^the Dask worker tcp://\S+ has dse \S+, not 0\.0\.9 as"):
        executor._check([])
    with pytest.raises(StoreError, match=r"^the Dask worker tcp://\S+ has dse \S+, not 0\.0\.9 as this"):
        list(workers.stream(parts, ["a"]))  # one that has joined since


def test_workers_that_end_while_they_start_are_one_line(monkeypatch):
    starts = []

    def failing(**_):
        starts.append(1)
        raise RuntimeError("Nanny failed to start.")

    monkeypatch.setattr("distributed.LocalCluster", failing)
    with pytest.raises(
        StoreError, match=r"ended while they started \(RuntimeError: Nanny failed.*; finished"
    ):
        Dask(2, None, None)
    assert len(starts) == 3


def test_what_a_user_writes_about_a_cluster(tmp_path, monkeypatch, capsys):
    tiny_study.write_recordings(tmp_path / "tiny.npz")
    space = {**tiny_study.plain(), "model": {"kind": "knn"}}
    path = tmp_path / "tiny.yaml"

    def loaded(**execution):
        path.write_text(yaml.safe_dump({**space, "execution": execution}, sort_keys=False))
        return load_space(path)

    monkeypatch.setattr(on_dask, "_CONNECT_S", 0.5)
    with pytest.raises(ConfigError, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:9 "):
        explore.run(loaded(backend="dask", address="tcp://127.0.0.1:9"), tmp_path, progress=False)
    with pytest.raises(ConfigError, match=r"s\.json: there is no such scheduler file"):
        explore.run(loaded(backend="dask", scheduler_file="s.json"), tmp_path, progress=False)
    assert main(["run", str(path), "--results", str(tmp_path), "--quiet"]) == 2
    printed = capsys.readouterr()
    assert printed.out == "" and printed.err.count("\n") == 1
    assert "s.json: there is no such scheduler file" in printed.err


@pytest.fixture
def cluster(tmp_path):
    """A scheduler with a worker, as on a cluster; the address, and both processes."""
    file = tmp_path / "scheduler.json"
    begin = [sys.executable, "-W", "ignore", "-m", "distributed.cli"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
    options = ["--no-dashboard", "--scheduler-file", str(file)]
    scheduler = ["dask_scheduler", "--host", "127.0.0.1", "--port", "0", *options]
    processes = []
    for command in (scheduler, ["dask_worker", "--nthreads", "1", "--no-nanny", *options]):
        module = f"{begin[-1]}.{command[0]}"
        processes.append(
            subprocess.Popen(
                [*begin[:-1], module, *command[1:]],
                cwd=tmp_path,
                env=environment,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
        )
        until(file.exists, "the scheduler to write its file")
    yield str(file), processes
    for process in processes:
        process.kill()
        process.wait()


def test_a_lost_scheduler_loses_no_finished_run(cluster, tmp_path, monkeypatch):
    file, (scheduler, worker) = cluster
    model = tiny_study.plain()["model"]
    for name in ("whole", "lost"):
        (tmp_path / name).mkdir()
    execution = {"backend": "dask", "scheduler_file": file}
    space = tiny_study.make_space(tmp_path / "lost", model=model, execution=execution)
    monkeypatch.setenv("DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT", "1s")
    waiting = _ThatLoses(tmp_path / "lost", scheduler)
    import dask

    with (
        dask.config.set({"distributed.comm.timeouts.connect": "1s"}),
        pytest.MonkeyPatch.context() as patch,
        pytest.raises(StoreError, match=r"^the Dask scheduler at .* is lost; finished runs are kept"),
    ):
        patch.setattr(explore._Tables, "refresh", waiting)
        explore.run(space, tmp_path / "lost" / "results", progress=False)
    kept = finished_runs(tmp_path / "lost")
    assert kept
    worker.kill()
    again = tiny_study.make_space(tmp_path / "lost", model=model, execution={"jobs": 1})
    explore.run(again, tmp_path / "lost" / "results", progress=False)
    whole = tiny_study.make_space(tmp_path / "whole", model=model, execution={"jobs": 1})
    explore.run(whole, tmp_path / "whole" / "results", progress=False)
    assert kept.items() <= finished_runs(tmp_path / "lost").items()
    assert_same(tmp_path / "lost", results.open(tmp_path / "whole" / "results" / "tiny"))


class _ThatLoses:
    """Kills a process when two runs of a study have finished."""

    def __init__(self, folder: Path, process: subprocess.Popen[bytes]) -> None:
        self._folder = folder
        self._process = process

    def __call__(self, *_: object) -> None:
        if len(finished_runs(self._folder)) >= 2:
            self._process.kill()
            self._process.wait()
