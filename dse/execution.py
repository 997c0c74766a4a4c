"""A function over jobs, in worker processes: one job at a time and one thread each.

A worker that dies (killed for memory, segmentation fault) costs the job it was running and nothing
else: it is replaced, and the job's result is a `Failure` that names the signal. A shared pool such as
joblib's cannot promise that: one dead worker ends every job in flight and nobody knows whose fault it
was. Workers stand in a process group of their own, so Ctrl-C reaches the parent alone, and they end
with the parent however it ends, because the pipe between them closes. POSIX only.
"""

from __future__ import annotations

import contextlib
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
from typing import Any, TypeVar

Job = TypeVar("Job")
Result = TypeVar("Result")

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


@dataclass(frozen=True)
class Failure:
    """Why a job has no result: the exception's class name, its message and its traceback; or 'WorkerDied'."""

    error: str
    message: str
    details: str = ""

    @property
    def reason(self) -> str:
        """The failure in one line."""
        if self.error == WORKER_DIED:
            return self.message
        return f"{self.error}: {self.message}" if self.message else self.error


class Workers:
    """Up to `n` worker processes, started when first needed and kept until the `with` block ends.

    One `map` at a time.

    Raises:
        ValueError: n is below 1.
    """

    def __init__(self, n: int) -> None:
        if n < 1:
            raise ValueError(f"jobs must be at least 1, got {n}")
        self._n = n
        self._idle: list[_Worker] = []

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *_: object) -> None:
        for worker in self._idle:
            worker.kill()
        self._idle.clear()

    def _free(self) -> _Worker:
        """Return an idle worker, or a new one; a worker that died while idle is no job's fault."""
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
        waiting = iter(jobs)
        busy: dict[Any, tuple[_Worker, Job]] = {}
        try:
            while True:
                for job in itertools.islice(waiting, self._n - len(busy)):
                    worker = self._free()
                    busy[worker.connection] = worker, job
                    worker.send((function, job))
                if not busy:
                    return
                for ready in wait(list(busy)):
                    worker, job = busy.pop(ready)
                    result = worker.receive()
                    if worker.is_alive:
                        self._idle.append(worker)
                    yield job, result
        finally:  # the caller stopped listening: what still runs is of no use
            for worker, _ in busy.values():
                worker.kill()


@dataclass(frozen=True)
class _Worker:
    """A worker seen from the parent."""

    process: subprocess.Popen[bytes]
    connection: Connection

    @classmethod
    def start(cls) -> _Worker:
        ours, theirs = multiprocessing.Pipe()
        path = os.pathsep.join(entry for entry in sys.path if entry)
        command = f"from dse.execution import _serve; _serve({theirs.fileno()})"
        process = subprocess.Popen(
            [sys.executable, "-c", command],
            stdin=subprocess.DEVNULL,
            stdout=2,  # stdout carries results; whatever a library prints in a worker is no result
            env={**os.environ, **THREADS, "PYTHONPATH": path},
            pass_fds=[theirs.fileno()],
            process_group=0,
        )
        theirs.close()
        return cls(process, ours)

    @property
    def is_alive(self) -> bool:
        return not self.connection.closed

    def send(self, message: Any) -> None:
        data = pickle.dumps(message)
        with contextlib.suppress(BrokenPipeError):  # it died just now: receive() reports it
            self.connection.send_bytes(data)

    def receive(self) -> Any:
        try:
            return self.connection.recv()
        except (EOFError, ConnectionResetError):
            # Whoever kills a process tree may reach the worker first: do not blame the job if we die too.
            time.sleep(_GRACE_S)
            code = self.process.wait()
            self.connection.close()
            how = f"signal {-code}" if code < 0 else f"exit code {code}"
            return Failure(WORKER_DIED, f"worker died: {how}")

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
        connection.send_bytes(_answer(messages.get()))


def _listen(connection: Connection, messages: queue.SimpleQueue[bytes]) -> None:
    while True:
        try:
            messages.put(connection.recv_bytes())
        except (EOFError, OSError):
            os._exit(0)


def _answer(message: bytes) -> bytes:
    try:
        function, job = pickle.loads(message)
        return pickle.dumps(function(job))
    except Exception as error:
        return pickle.dumps(Failure(type(error).__name__, str(error), traceback.format_exc()))
