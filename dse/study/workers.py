"""A function over jobs, in worker processes: one job at a time and one thread each.

A job may yield its result in parts, which arrive at once: parts that arrived before the job ended early stay
valid.

A worker that dies (killed for memory, segmentation fault) costs the job that it was running and nothing
else: it is replaced, and the job's result is a `Failure` that names the signal. A shared pool such as
joblib's cannot do this: one dead worker ends every running job and hides the job that killed it. Each worker
has a separate process group, so Ctrl-C reaches the parent alone; workers end with the parent, however it
ends, because the pipe between them closes. POSIX only.

A job may hold components of plugins: a worker loads the plugins that its parent has loaded.
"""

from __future__ import annotations

import contextlib
import functools
import itertools
import multiprocessing
import os
import pickle
import queue
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, TypeVar

from dse import registry

Job = TypeVar("Job")
Result = TypeVar("Result")
Part = TypeVar("Part")

THREADS = {
    name: "1"
    for name in (
        "OMP_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "MKL_NUM_THREADS",
        "VECLIB_MAXIMUM_THREADS",
        "NUMEXPR_NUM_THREADS",
        "NUMBA_NUM_THREADS",
    )
}
"""Set before a worker's interpreter starts: numerical libraries read them when they are imported."""

WORKER_DIED = "WorkerDied"
_GRACE_S = 0.2
# Where Linux states the memory limit of a container: cgroup v2, then v1.
_CONTAINER_LIMITS = ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes")


@dataclass(frozen=True)
class Failure:
    """Why a job has no result: the exception's class name, its message and its traceback; or 'WorkerDied'."""

    error: str
    message: str
    details: str = ""

    @classmethod
    def of(cls, error: Exception) -> Failure:
        """Return an exception as a failure."""
        return cls(type(error).__name__, str(error), "".join(traceback.format_exception(error)))

    @property
    def reason(self) -> str:
        """The failure in one line."""
        if self.error == WORKER_DIED:
            return self.message
        return f"{self.error}: {self.message}" if self.message else self.error


def memory_budget(gib: float | None, n_workers: int, device: str) -> int:
    """Return the bytes that a worker may use: as stated, else an equal part of three quarters of the memory.

    Args:
        gib: stated budget; None: not stated.
        n_workers: workers that share the memory.
        device: 'cpu' for the machine's memory, 'cuda' for the first GPU's.
    """
    return int(gib * 2**30) if gib is not None else 3 * _memory(device) // (4 * n_workers)


def _memory(device: str) -> int:
    """Return a device's memory in bytes; in a container, at most the container's limit."""
    if device == "cuda":
        import torch

        if torch.cuda.is_available():
            return int(torch.cuda.get_device_properties(0).total_memory)
    machine = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    limits = [path.read_text().strip() for path in map(Path, _CONTAINER_LIMITS) if path.is_file()]
    return min([machine, *(int(limit) for limit in limits if limit.isdecimal())])


class Workers:
    """Up to `n` worker processes, started when first needed and ended with the `with` block.

    One `map` or `stream` at a time.

    Raises:
        ValueError: n is below 1.
    """

    def __init__(self, n: int) -> None:
        if n < 1:
            raise ValueError(f"jobs must be at least 1, got {n}")
        self.n = n
        self._idle: list[_Worker] = []

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *_: object) -> None:
        for worker in self._idle:
            worker.kill()
        self._idle.clear()

    def _free(self) -> _Worker:
        """Return an idle worker, or a new one; no job is blamed for a worker that died while idle."""
        while self._idle:
            worker = self._idle.pop()
            if worker.process.poll() is None:
                return worker
            worker.kill()
        return _Worker.start()

    def map(
        self, function: Callable[[Job], Result], jobs: Iterable[Job]
    ) -> Iterator[tuple[Job, Result | Failure]]:
        """Yield every job with its result as it finishes, in no particular order.

        Args:
            function: importable by name; it is called in a worker.
            jobs: taken one by one as workers become free; pickled, so keep them small.
        """
        return self.stream(functools.partial(_once, function), jobs)

    def stream(
        self, function: Callable[[Job], Iterable[Part]], jobs: Iterable[Job]
    ) -> Iterator[tuple[Job, Part | Failure]]:
        """Yield every part that the function yields for a job, with its job, as soon as it arrives.

        A job that ends early, by an exception or by its worker's death, ends with a `Failure`; earlier parts
        stay valid.

        Args:
            function: importable by name; it is called in a worker.
            jobs: taken one by one as workers become free; pickled, so keep them small.
        """
        waiting = iter(jobs)
        busy: dict[Connection, tuple[_Worker, Job]] = {}
        try:
            while True:
                for job in itertools.islice(waiting, self.n - len(busy)):
                    worker = self._free()
                    busy[worker.connection] = worker, job
                    worker.send((function, job))
                if not busy:
                    return
                for ready in wait(list(busy)):
                    assert isinstance(ready, Connection)  # nothing else is waited for
                    worker, job = busy[ready]
                    is_last, part = worker.receive()
                    if is_last:
                        del busy[ready]
                        if worker.is_alive:
                            self._idle.append(worker)
                    if not is_last or part is not None:
                        yield job, part
        finally:  # the caller has stopped: nobody reads the results of running jobs
            for worker, _ in busy.values():
                worker.kill()


def _once(function: Callable[[Job], Result], job: Job) -> Iterator[Result]:
    yield function(job)


@dataclass(frozen=True)
class _Worker:
    """A worker seen from the parent."""

    process: subprocess.Popen[bytes]
    connection: Connection

    @classmethod
    def start(cls) -> _Worker:
        ours, theirs = multiprocessing.Pipe()
        path = os.pathsep.join(entry for entry in sys.path if entry)
        command = f"from dse.study.workers import _serve; _serve({theirs.fileno()})"
        process = subprocess.Popen(
            [sys.executable, "-c", command],
            stdin=subprocess.DEVNULL,
            stdout=2,  # stdout is for results: what a library prints in a worker goes to stderr
            env={**os.environ, **THREADS, "PYTHONPATH": path},
            pass_fds=[theirs.fileno()],
            process_group=0,
        )
        theirs.close()
        return cls(process, ours)

    @property
    def is_alive(self) -> bool:
        return not self.connection.closed

    def send(self, message: object) -> None:
        data = pickle.dumps((registry.loaded_plugins(), pickle.dumps(message)))
        with contextlib.suppress(BrokenPipeError):  # it died just now: receive() reports it
            self.connection.send_bytes(data)

    def receive(self) -> tuple[bool, Any]:
        """Return whether the job has ended, and its next part; at its end a `Failure` or None."""
        try:
            is_last, part = self.connection.recv()
            return is_last, part
        except (EOFError, ConnectionResetError):
            # Whoever kills a process tree may reach the worker first: do not blame the job if we die too.
            time.sleep(_GRACE_S)
            code = self.process.wait()
            self.connection.close()
            how = f"signal {-code}" if code < 0 else f"exit code {code}"
            return True, Failure(WORKER_DIED, f"worker died: {how}")

    def kill(self) -> None:
        self.connection.close()
        self.process.kill()
        self.process.wait()


def _serve(descriptor: int) -> None:
    """Run jobs from the pipe until the parent closes it, which ends the process at once."""
    connection = Connection(descriptor)
    messages: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(connection, messages), daemon=True).start()
    while True:
        for answer in _answers(messages.get()):
            connection.send_bytes(answer)


def _listen(connection: Connection, messages: queue.SimpleQueue[bytes]) -> None:
    while True:
        try:
            messages.put(connection.recv_bytes())
        except (EOFError, OSError):
            os._exit(0)


def _answers(message: bytes) -> Iterator[bytes]:
    """Yield the parts of a job, then why it ended: None, or a failure."""
    end = None
    try:
        plugins, content = pickle.loads(message)
        registry.load_the_same(plugins)  # before the job is unpickled: it may hold their components
        function, job = pickle.loads(content)
        for part in function(job):
            yield pickle.dumps((False, part))
    except Exception as error:
        end = Failure.of(error)
    yield pickle.dumps((True, end))
