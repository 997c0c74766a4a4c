"""Coordinators and workers that are killed at random moments: no run is lost or made twice."""

from __future__ import annotations

import os
import random
import resource
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from multiprocessing.context import ForkServerProcess
from pathlib import Path

import pandas as pd
import psutil
import pytest

from dse.cli import main
from dse.study import results
from dse.study import workers as study_workers
from dse.study.results import Study
from tests import tiny_study
from tests.in_process import InProcess
from tests.study import test_crash
from tests.study.test_crash import ROOT, assert_same, finished_runs
from tests.waiting import PATIENCE_S, until

MOST_KILLS = 3
"""In a study: its runs are begun again three times, and at the next session."""


@pytest.fixture(scope="module", autouse=True)
def fake_model() -> Iterator[None]:
    tiny_study.register()
    yield
    tiny_study.unregister()


def prepare(folder: Path, backend: str, seconds: float = 0.15) -> Path:
    folder.mkdir()
    model = {**tiny_study.plain()["model"], "seconds": seconds}
    execution = {"jobs": 2, "backend": backend}
    tiny_study.make_space(folder, model=model, search={"sampler": "grid", "batch": 4}, execution=execution)
    return folder


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Study:
    folder = prepare(tmp_path_factory.mktemp("execution") / "whole", "loky", seconds=0.0)
    assert tiny_study.run_folder(str(folder)) == 0
    return results.open(folder / "results" / "tiny")


def start(folder: Path) -> subprocess.Popen[bytes]:
    code = f"import sys; from tests.tiny_study import run_folder; sys.exit(run_folder({str(folder)!r}))"
    return subprocess.Popen([sys.executable, "-W", "ignore", "-c", code], cwd=ROOT, start_new_session=True)


def workers_of(coordinator: subprocess.Popen[bytes]) -> list[psutil.Process]:
    found = []
    for process in psutil.Process(coordinator.pid).children(recursive=True):
        try:
            command = " ".join(process.cmdline())
        except psutil.Error:
            continue
        if ("popen_loky" in command or "spawn_main" in command) and "resource_tracker" not in command:
            found.append(process)
    return found


@pytest.mark.parametrize("backend", ["loky", "dask"])
def test_killed_at_random_moments(
    tmp_path: Path, whole: Study, backend: str, n_faults: int, tried: Counter[str]
) -> None:
    for number in range(max(1, n_faults // 10)):
        rng = random.Random(f"{backend} {number}")
        folder = prepare(tmp_path / str(number), backend)
        kept: dict[str, tuple[int, int]] = {}
        process, n_kills, of_worker = start(folder), 0, rng.random() < 0.6
        try:
            while process.poll() is None or n_kills < MOST_KILLS:
                time.sleep(rng.uniform(0.0, 1.0))
                victims = workers_of(process) if process.poll() is None else []
                if process.poll() is not None:
                    n_kills = MOST_KILLS
                elif n_kills == MOST_KILLS:
                    process.wait(PATIENCE_S)
                elif victims and of_worker:
                    rng.choice(victims).kill()
                    n_kills += 1
                    of_worker = rng.random() < 0.6
                    tried[f"a worker killed, {backend}"] += 1
                elif not of_worker and finished_runs(folder).keys() - kept.keys():
                    process.send_signal(signal.SIGKILL)
                    process.wait()
                    n_kills += 1
                    of_worker = rng.random() < 0.6
                    tried[f"the coordinator killed, {backend}"] += 1
                    assert kept.items() <= finished_runs(folder).items(), "a run was lost or made twice"
                    kept = finished_runs(folder)
                    process = start(folder)
        finally:
            process.kill()
            process.wait()
        assert tiny_study.run_folder(str(folder)) == 0
        assert kept.items() <= finished_runs(folder).items(), "a run was lost or made twice"
        assert_same(folder, whole)
        assert set(results.open(folder / "results" / "tiny").trials["status"]) == {"finished"}


def command(folder: Path, more_kib: int | None, cache: str) -> None:
    """Run the study of a folder as the command line does, with little more memory than there is now."""
    os.environ["DSE_CACHE"] = cache
    os.dup2(os.open(folder / "told", os.O_WRONLY | os.O_CREAT), 2)
    study_workers.Loky = InProcess  # type: ignore[assignment, misc]
    tiny_study.register()
    if more_kib is not None:
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + (more_kib << 10),) * 2)
    arguments = ["run", str(folder / "tiny.yaml"), "--results", str(folder / "results"), "--quiet"]
    sys.exit(main(arguments))


def start_command(folder: Path, more_kib: int | None = None) -> ForkServerProcess:
    test_crash.CHILDREN.set_forkserver_preload([__name__, *test_crash.LAZY])
    arguments = folder, more_kib, os.environ["DSE_CACHE"]
    process = test_crash.CHILDREN.Process(target=command, args=arguments, daemon=True)
    process.start()
    return process


def test_a_process_without_memory(tmp_path: Path, whole: Study, n_faults: int, tried: Counter[str]) -> None:
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


@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_a_signal_ends_a_run_with_its_tables(
    tmp_path: Path, number: signal.Signals, code: int, tried: Counter[str]
) -> None:
    model = {**tiny_study.plain()["model"], "gate": str(tmp_path / "gate"), "hidden": {"choice": [[8], [4]]}}
    tiny_study.make_space(tmp_path, model=model, execution={"jobs": 1})
    process = start_command(tmp_path)
    until(lambda: process.exitcode is not None or bool(finished_runs(tmp_path)), "a first run")
    assert process.pid is not None
    os.kill(process.pid, number)
    process.join(PATIENCE_S)
    told = (tmp_path / "told").read_text()
    assert (process.exitcode, told.startswith(f"stopped by {number.name}; finished trials")) == (code, True)
    assert len(pd.read_parquet(tmp_path / "results" / "tiny" / "trials.parquet")) >= 1
    tried["a signal"] += 1


def test_two_coordinators_on_one_folder(tmp_path: Path, whole: Study) -> None:
    folder = prepare(tmp_path / "twice", "loky")
    both = [test_crash.start(folder), test_crash.start(folder)]
    for process in both:
        process.join(PATIENCE_S)
    codes = sorted(process.exitcode or 0 for process in both)
    assert codes in ([0, 0], [0, 2]), "the second one finds the folder in use, or finished"
    assert_same(folder, whole)
