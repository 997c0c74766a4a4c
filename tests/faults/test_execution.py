"""Coordinators and workers that are killed at any moment of a study: no run is lost or made twice."""

from __future__ import annotations

import contextlib
import functools
import importlib.util
import os
import platform
import random
import resource
import signal
import subprocess
import sys
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
import psutil
import pytest

from dse.cli import main
from dse.study import results
from dse.study import workers as study_workers
from tests import tiny_study
from tests.in_process import Forked, InProcess
from tests.study import test_crash
from tests.study.test_crash import assert_same, finished_runs
from tests.waiting import PATIENCE_S, until

N_RUNS = 6
VICTIMS = ("worker", "worker", "coordinator", "coordinator")
"""Who is killed in a study: a run is begun again three times, and at the next session."""
SHARES = {"forked": 8, "loky": 60, "dask": 60}
"""Of so many faults, one is a study with that executor."""


def prepare(folder, backend, seconds=0.15):
    folder.mkdir()
    model = {**tiny_study.plain()["model"], "seconds": seconds}
    execution = {"jobs": 2, "backend": backend}
    tiny_study.make_space(folder, model=model, search={"sampler": "grid", "batch": 4}, execution=execution)
    return folder


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = prepare(tmp_path_factory.mktemp("execution") / "whole", "loky", seconds=0.0)
    assert tiny_study.run_folder(str(folder)) == 0
    return results.open(folder / "results" / "tiny")


def workers_of(coordinator, backend):
    found = []
    with contextlib.suppress(psutil.NoSuchProcess):
        for process in psutil.Process(coordinator).children(recursive=True):
            with contextlib.suppress(psutil.Error):
                command = " ".join(process.cmdline())
                is_worker = "popen_loky" in command or "spawn_main" in command
                if backend == "forked" or (is_worker and "resource_tracker" not in command):
                    found.append(process)
    return found


def killed_worker(coordinator, backend, rng):
    """Kill a worker, as soon as there is one; return whether the study went on so long."""
    while coordinator.exitcode is None:
        assert coordinator.pid is not None
        if victims := workers_of(coordinator.pid, backend):
            with contextlib.suppress(psutil.NoSuchProcess):  # its job ended meanwhile
                rng.choice(victims).kill()
                return True
        time.sleep(0.002)
    return False


def killed_coordinator(coordinator, backend):
    """Kill a coordinator; wait for the job of a forked one, which has its lock, as no other worker has."""
    assert coordinator.pid is not None
    os.kill(coordinator.pid, signal.SIGSTOP)
    left = workers_of(coordinator.pid, backend) if backend == "forked" else []
    test_crash.killed(coordinator)
    until(lambda: not any(map(is_alive, left)), "jobs of a killed coordinator to end")


def is_alive(process):
    with contextlib.suppress(psutil.NoSuchProcess):
        return bool(process.is_running() and process.status() != psutil.STATUS_ZOMBIE)
    return False


@pytest.mark.parametrize("backend", SHARES)
def test_killed_at_moments_spread_over_a_study(tmp_path, whole, backend, n_faults, tried):
    """The moments: a number of finished runs, drawn, and a part of a run."""

    executor = Forked if backend == "forked" else None
    victims = VICTIMS if n_faults >= 100 or backend == "forked" else VICTIMS[1:3]  # slow to start
    for number in range(max(1, n_faults // SHARES[backend])):
        rng = random.Random(f"{backend} {number}")
        folder = prepare(tmp_path / str(number), "dask" if backend == "dask" else "loky", seconds=0.06)
        kept = {}
        process = test_crash.start(folder, executor=executor)
        moments = sorted(rng.sample(range(N_RUNS), len(victims)))
        for n_finished, of in zip(moments, rng.sample(victims, len(victims)), strict=True):
            test_crash.wait_until(process, lambda at=folder, n=n_finished: len(finished_runs(at)) >= n)
            time.sleep(rng.uniform(0.0, 0.1))
            if of == "worker" and not killed_worker(process, backend, rng):
                break
            if of == "coordinator" and process.exitcode is not None:
                break
            if of == "coordinator":
                killed_coordinator(process, backend)
                assert kept.items() <= finished_runs(folder).items(), "a run was lost or made twice"
                kept = finished_runs(folder)
                process = test_crash.start(folder, executor=executor)
            tried[f"a {of} killed, {backend}"] += 1
        process.join(PATIENCE_S)
        assert process.exitcode == 0, (number, (folder / "told").read_text())
        assert tiny_study.run_folder(str(folder)) == 0
        assert kept.items() <= finished_runs(folder).items(), "a run was lost or made twice"
        assert_same(folder, whole)
        assert set(results.open(folder / "results" / "tiny").trials["status"]) == {"finished"}


def command(folder, more_kib, cache, executor=InProcess):
    """Run the study of a folder as the command line does, with little more memory than there is now."""
    os.environ["DSE_CACHE"] = cache
    os.dup2(os.open(folder / "told", os.O_WRONLY | os.O_CREAT), 2)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # ignored where the tests run under nohup
    study_workers.Loky = executor
    tiny_study.register()
    if more_kib is not None:
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + (more_kib << 10),) * 2)
    arguments = ["run", str(folder / "tiny.yaml"), "--results", str(folder / "results"), "--quiet"]
    sys.exit(main(arguments))


def start_command(folder, more_kib=None, executor=InProcess):
    test_crash.CHILDREN.set_forkserver_preload([__name__, *test_crash.LAZY])
    arguments = folder, more_kib, os.environ["DSE_CACHE"], executor
    process = test_crash.CHILDREN.Process(target=command, args=arguments, daemon=True)
    process.start()
    return process


def test_a_process_without_memory(tmp_path, whole, n_faults, tried):
    codes = Counter[int | None]()
    for number in range(max(1, n_faults // 10)):
        rng = random.Random(f"memory {number}")
        folder = prepare(tmp_path / str(number), "loky", seconds=0.0)
        more = rng.choice((0, 200, 1000, 4000, 16_000, 64_000))
        process = start_command(folder, more)
        process.join(PATIENCE_S)
        told = (folder / "told").read_text()
        codes[process.exitcode] += 1
        is_native = process.exitcode not in (0, 1, 2)  # the C library ended the process: as if killed
        assert is_native or told.count("\n") <= 1, (number, process.exitcode, told)
        assert "Traceback" not in told, (number, told)
        before = finished_runs(folder)
        assert tiny_study.run_folder(str(folder)) == 0
        assert before.items() <= finished_runs(folder).items(), "a run was lost or made twice"
        assert_same(folder, whole)
        tried["no memory"] += 1
    assert codes[2] or n_faults < 100, codes  # one run alone may end natively


def test_a_clock_that_jumps_for_all_processes(tmp_path, whole, n_faults, tried):
    """By libfaketime: what coordinator and workers read as the time is another every few moments."""
    spec = importlib.util.find_spec("libfaketime")
    if n_faults < 100 or spec is None or spec.origin is None or platform.machine() != "x86_64":
        pytest.skip("processes of their own: only with all faults, on x86-64")
    library = Path(spec.origin).parent / "vendor" / "libfaketime" / "src" / "libfaketime.so.1"
    clock, rng = tmp_path / "clock", random.Random(29)

    def jump():
        (tmp_path / "next").write_text(f"{rng.randint(-30, 30) * 86400 + rng.randint(-600, 600):+d}")
        (tmp_path / "next").replace(clock)

    jump()
    faked = {
        **{"LD_PRELOAD": str(library), "FAKETIME_TIMESTAMP_FILE": str(clock), "FAKETIME_NO_CACHE": "1"},
        **{"FAKETIME_DONT_FAKE_MONOTONIC": "1", "NO_FAKE_STAT": "1"},
    }
    folder = prepare(tmp_path / "jumping", "loky", seconds=0.3)
    code = "import sys, time; from tests.tiny_study import run_folder; print(time.time(), flush=True)"
    command = [sys.executable, "-c", f"{code}; sys.exit(run_folder({str(folder)!r}))"]
    for _ in range(2):  # the second one finds all
        process = subprocess.Popen(
            command, cwd=test_crash.ROOT, env={**os.environ, **faked}, stdout=subprocess.PIPE, text=True
        )
        with process:
            assert process.stdout is not None
            assert abs(float(process.stdout.readline()) - time.time()) > 1, "its clock is another"
            while process.poll() is None:
                jump()
                tried["a clock that jumps, of all processes"] += 1
                time.sleep(0.1)
        assert process.returncode == 0
        assert_same(folder, whole)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_a_signal_ends_a_run_with_its_tables(tmp_path, number, code, tried):
    model = {**tiny_study.plain()["model"], "gate": str(tmp_path / "gate"), "hidden": {"choice": [[8], [4]]}}
    tiny_study.make_space(tmp_path, model=model, execution={"jobs": 1})
    process = start_command(tmp_path)
    until(lambda: process.exitcode is not None or bool(finished_runs(tmp_path)), "a first run")
    assert process.pid is not None
    os.kill(process.pid, number)
    process.join(PATIENCE_S)
    told = (tmp_path / "told").read_text()
    n_trials = len(pd.read_parquet(tmp_path / "results" / "tiny" / "trials.parquet"))
    assert n_trials >= 1
    held, stopped = told.splitlines()[:2]
    assert held.startswith(f"the tables hold {n_trials} of ")
    assert (process.exitcode, stopped.startswith(f"stopped by {number.name}; finished trials")) == (
        code,
        True,
    )
    tried["a signal"] += 1


@dataclass
class Dying:
    """Signals its process as it is deleted, where Python swallows exceptions."""

    number: signal.Signals

    def __del__(self) -> None:
        os.kill(os.getpid(), self.number)
        for _ in range(100):  # here the signal is handled
            pass


@dataclass
class Swallowing(InProcess):
    """Is signalled in each task, which waits for that."""

    number: signal.Signals = signal.SIGTERM

    def _perform(self, task: bytes) -> bytes:
        Dying(self.number)
        until(lambda: False, "the signal to come again")
        raise AssertionError


@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
def test_a_signal_that_python_swallows_comes_again(tmp_path, number, code, tried):
    tiny_study.make_space(tmp_path, execution={"jobs": 1})
    process = start_command(tmp_path, executor=functools.partial(Swallowing, number=number))
    process.join(PATIENCE_S)
    told = (tmp_path / "told").read_text()
    assert (process.exitcode, "Exception ignored" in told) == (code, False), told
    tried["a signal"] += 1


def test_two_coordinators_on_one_folder(tmp_path, whole):
    folder = prepare(tmp_path / "twice", "loky")
    both = [test_crash.start(folder), test_crash.start(folder)]
    for process in both:
        process.join(PATIENCE_S)
    codes = sorted(process.exitcode or 0 for process in both)
    assert codes in ([0, 0], [0, 2]), "the second one finds the folder in use, or finished"
    assert_same(folder, whole)
