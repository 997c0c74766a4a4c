"""Coordinators and workers that are killed at random moments: no run is lost or made twice."""

from __future__ import annotations

import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from dse.study import results
from dse.study.results import Study
from tests import tiny_study
from tests.study import test_crash
from tests.study.test_crash import ROOT, assert_same, finished_runs
from tests.waiting import PATIENCE_S

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
def test_killed_at_random_moments(tmp_path: Path, whole: Study, backend: str, n_faults: int) -> None:
    for number in range(max(1, n_faults // 10)):
        rng = random.Random(f"{backend} {number}")
        folder = prepare(tmp_path / str(number), backend)
        kept: dict[str, tuple[int, int]] = {}
        process, n_kills = start(folder), 0
        try:
            while process.poll() is None or n_kills < MOST_KILLS:
                time.sleep(rng.uniform(0.0, 1.0))
                victims = workers_of(process) if process.poll() is None else []
                if process.poll() is not None:
                    n_kills = MOST_KILLS
                elif n_kills == MOST_KILLS:
                    process.wait(PATIENCE_S)
                elif victims and rng.random() < 0.7:
                    rng.choice(victims).kill()
                    n_kills += 1
                elif finished_runs(folder):
                    process.send_signal(signal.SIGKILL)
                    process.wait()
                    n_kills += 1
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


def test_two_coordinators_on_one_folder(tmp_path: Path, whole: Study) -> None:
    folder = prepare(tmp_path / "twice", "loky")
    both = [test_crash.start(folder), test_crash.start(folder)]
    for process in both:
        process.join(PATIENCE_S)
    codes = sorted(process.exitcode or 0 for process in both)
    assert codes in ([0, 0], [0, 2]), "the second one finds the folder in use, or finished"
    assert_same(folder, whole)
