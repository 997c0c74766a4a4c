"""Jobs in worker processes: results, failures, deaths, and ends."""

from __future__ import annotations

import functools
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path

import pytest
from joblib.externals.loky.process_executor import _ExecutorManagerThread

from dse.base import registry
from dse.study.executors import loky
from dse.study.executors.work import THREADS, Failure, pack
from dse.study.workers import OutOfTime, Workers
from tests.waiting import PATIENCE_S, until

WORKERS = True


def mapped(workers, function, jobs):
    """Yield jobs with what a function returns for them."""
    return workers.stream(functools.partial(once, function), jobs)


def once(function, job):
    yield function(job)


def square(x):
    return x * x


def misbehave(job):
    if job.isdigit():
        os.kill(os.getpid(), int(job))
    if job == "exit":
        os._exit(3)
    if job == "raise":
        raise ValueError("phi must be at least 0")
    if job == "memory":
        raise MemoryError
    if job == "print":
        print("a library's chatter")
    if job == "lambda":
        return lambda: None
    return job.upper()


def environment(names):
    return [os.environ.get(name) for name in names]


def sleep(seconds):
    time.sleep(seconds)
    return os.getpid()


@pytest.fixture(scope="module")
def pool():
    with Workers(2) as workers:
        yield workers


def test_every_job_comes_back_once_with_its_result(pool):
    assert sorted(mapped(pool, square, range(7))) == [(x, x * x) for x in range(7)]
    assert list(mapped(pool, square, [])) == []


def test_a_dead_worker_costs_its_own_job_only():
    jobs = ["a", str(int(signal.SIGKILL)), "b", "exit"]
    with Workers(2) as workers:
        results = dict(mapped(workers, misbehave, jobs))
    assert {job: results[job] for job in "ab"} == {"a": "A", "b": "B"}
    assert results["9"] == Failure.died("signal 9")
    assert results["exit"] == Failure.died("exit code 3")


def test_an_exception_is_a_failure_with_its_reason_and_its_traceback(pool):
    results = dict(mapped(pool, misbehave, ["raise", "memory", "lambda", "fine"]))
    raised = results["raise"]
    assert (raised.error, raised.reason) == ("ValueError", "ValueError: phi must be at least 0")
    assert "in misbehave" in raised.details
    assert results["memory"].reason == "MemoryError"
    assert isinstance(results["lambda"], Failure)
    assert results["fine"] == "FINE"


def count_to(job):
    n, end = job
    yield from range(n)
    misbehave(end)


def test_parts_before_an_exception_stand():
    jobs = [(2, "fine"), (0, "fine"), (3, "raise"), (1, str(int(signal.SIGKILL))), (2, "fine")]
    with Workers(1) as workers:
        found = list(workers.stream(count_to, jobs))
    parts = {job: [part for one, part in found if one == job] for job in jobs}
    assert parts[2, "fine"] == [0, 1, 0, 1]
    assert parts[0, "fine"] == []
    assert parts[3, "raise"][:3] == [0, 1, 2]
    assert isinstance(failure := parts[3, "raise"][3], Failure)
    assert failure.reason == "ValueError: phi must be at least 0"
    assert parts[1, "9"] == [Failure.died("signal 9")]
    assert len(found) == 2 + 2 + 4 + 1


@dataclass(frozen=True)
class Told:
    """A job that says what it does."""

    progress_file: Path


def tell(job):
    job.progress_file.write_text("half of it")
    until(lambda: not job.progress_file.exists(), "somebody to hear it")
    yield 1


def test_what_a_running_job_says_is_heard(pool, tmp_path):
    job = Told(tmp_path / "said")
    found = pool.stream(tell, [job])
    assert next(found) == (job, "half of it")
    job.progress_file.unlink()
    assert list(found) == [(job, 1)]


def test_a_worker_may_take_what_is_stated_or_its_share(tmp_path, monkeypatch):
    assert Workers(4).memory_budget(1.5, "cpu") == 3 * 2**29
    machine = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    assert 0 < Workers(1).memory_budget(None, "cpu") <= 3 * machine // 4
    limits = [tmp_path / "unlimited", tmp_path / "limit", tmp_path / "absent"]
    limits[0].write_text("max\n")
    limits[1].write_text(f"{8 * 2**20}\n")
    monkeypatch.setattr(loky, "_CONTAINER_LIMITS", limits)
    assert Workers(2).memory_budget(None, "cpu") == 3 * 2**20


def test_workers_have_one_thread_each(pool):
    [(_, found)] = mapped(pool, environment, [list(THREADS)])
    assert found == ["1"] * len(THREADS)


def test_one_worker_serves_all_calls_prints_to_stderr_and_costs_nothing_if_it_dies_while_idle(capfd):
    with Workers(1) as workers:
        list(mapped(workers, misbehave, ["print"]))
        [(_, first)], [(_, pid)] = (mapped(workers, sleep, [0.0]) for _ in range(2))
        captured = capfd.readouterr()
        assert captured.out == "" and "chatter" in captured.err
        assert first == pid and isinstance(pid, int)
        os.kill(pid, signal.SIGKILL)
        until(lambda: not loky._lives(pid), "the worker to die")
        assert list(mapped(workers, square, [3])) == [(3, 9)], "whether loky knows its end or not"


def test_leaving_the_block_ends_a_running_job_at_once():
    began = time.monotonic()
    with Workers(2) as workers:
        _, pid = next(mapped(workers, sleep, [0.0, 2 * PATIENCE_S]))
    assert time.monotonic() - began < PATIENCE_S
    assert _gone(pid)


def test_workers_end_where_psutil_finds_no_process(monkeypatch):
    """Without /proc, as in some containers and chroots, loky asks psutil in vain, and kills nobody."""
    psutil = pytest.importorskip("psutil")

    def process(pid=None):
        raise psutil.NoSuchProcess(pid)

    with Workers(1) as workers:
        [(_, pid)] = mapped(workers, sleep, [0.0])
        monkeypatch.setattr(psutil, "Process", process)
    assert _gone(pid)


def test_ctrl_c_while_a_task_is_submitted_leaves_no_worker(tmp_path, monkeypatch):
    place = tmp_path / "pid"
    submit = loky.Loky.submit

    def interrupted(self, task):
        submit(self, task)
        until(lambda: place.is_file() and place.read_text() != "", "the worker's process number")
        raise KeyboardInterrupt

    monkeypatch.setattr(loky.Loky, "submit", interrupted)
    with pytest.raises(KeyboardInterrupt), Workers(1) as workers:
        list(mapped(workers, announce, [str(place)]))
    assert _gone(int(place.read_text()))


def test_a_stop_before_a_worker_takes_its_task_ends_without_error(monkeypatch):
    wait, is_late = _ExecutorManagerThread.wait_result_broken_or_wakeup, threading.Event()

    def waited(self):
        arrived = wait(self)
        if is_late.is_set():
            until(lambda: self.executor_flags.shutdown, "the workers to be stopped")
        return arrived

    errors = []
    monkeypatch.setattr(_ExecutorManagerThread, "wait_result_broken_or_wakeup", waited)
    monkeypatch.setattr(threading, "excepthook", errors.append)
    executor = loky.Loky(1)
    task = pack(environment, [])
    executor.submit(task).result(PATIENCE_S)
    is_late.set()
    executor.submit(task)
    executor.close()
    assert errors == []


def test_workers_end_with_a_parent_that_is_killed(tmp_path):
    script = (
        "import os, pathlib, sys\n"
        "from dse.study.workers import OutOfTime, Workers\n"
        "from tests.study.test_workers import announce, mapped\n"
        "with Workers(1) as workers: list(mapped(workers, announce, [sys.argv[1]]))\n"
    )
    path = tmp_path / "pid"
    parent = subprocess.Popen([sys.executable, "-c", script, str(path)], cwd=Path(__file__).parents[2])
    try:
        until(lambda: path.exists() and path.read_text() != "", "the worker to start")
    finally:
        parent.kill()
        parent.wait()
    until(lambda: _gone(int(path.read_text())), "the worker to end")


def announce(path):
    Path(path).write_text(str(os.getpid()))
    time.sleep(2 * PATIENCE_S)


def test_jobs_below_one_are_refused():
    with pytest.raises(ValueError, match="jobs must be at least 1, got 0"):
        Workers(0)


def _gone(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    status = Path(f"/proc/{pid}/stat")  # an orphan that nobody has reaped yet is a zombie
    return status.exists() and status.read_text().rpartition(")")[2].split()[0] == "Z"


def kind_of(job):
    return type(job).__name__, job.order


def test_a_worker_loads_the_plugins_that_its_job_needs(tmp_path, monkeypatch):
    encoders = registry.known("encoders")
    monkeypatch.setattr(registry, "_plugins", {})
    monkeypatch.setattr(registry, "_components", {**registry._components, "encoders": encoders})
    path = tmp_path / "mine.py"
    path.write_text(
        "from dataclasses import dataclass\n"
        "from dse.base.registry import register\n"
        "@register('encoders', 'of_a_worker')\n"
        "@dataclass(frozen=True)\n"
        "class OfAWorker:\n"
        "    order: int = 2\n"
        "    n_channels = positions = encode_all = None\n"
    )
    registry.load_plugin(str(path))
    component = registry.known("encoders")["of_a_worker"]
    with Workers(1) as workers:
        assert list(mapped(workers, kind_of, [component(order=7)])) == [
            (component(order=7), ("OfAWorker", 7))
        ]
        path.write_text(path.read_text() + "# changed\n")
        [(_, result)] = mapped(workers, kind_of, [component(order=8)])
        assert result == ("OfAWorker", 8), "a worker that has loaded it does not look again"
    with Workers(1) as workers:
        [(_, failure)] = mapped(workers, kind_of, [component(order=9)])
        assert isinstance(failure, Failure) and "has changed since it was loaded" in failure.message


def test_jobs_that_run_when_time_is_over_are_ended():
    class Slow:
        n, closed = 1, 0

        def submit(self, task: bytes) -> Future[bytes]:
            return Future()  # it never ends

        def close(self) -> None:
            self.closed += 1

    executor = Slow()
    workers = Workers(1, executor, until_s=time.monotonic())
    assert workers.left_s == 0 and Workers(1, executor).left_s is None
    with pytest.raises(OutOfTime):
        next(mapped(workers, square, [1]))
    assert executor.closed == 1
