"""What a worker process does: load the plugins, run a job, return its parts. What runs such tasks.

A job is a function that yields parts. What it finishes is on the disk before it yields; nothing else is lost
with a worker.
"""

from __future__ import annotations

import os
import pickle
import sys
import traceback
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

from dse.base import registry
from dse.store import StoreError

Job = TypeVar("Job")
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
_OF_MACHINE = (MemoryError, OSError, StoreError)
_OUT_OF_GPU_MEMORY = "OutOfMemoryError"  # of torch, which need not be installed


@dataclass(frozen=True)
class Failure:
    """Why a job has no result: the exception's class name, its message and its traceback; or 'WorkerDied'.

    by_machine: the machine did it, not the job: the same job may succeed when it is run again.
    """

    error: str
    message: str
    details: str = ""
    by_machine: bool = False

    @classmethod
    def of(cls, error: BaseException) -> Failure:
        """Return an exception as a failure."""
        name = type(error).__name__
        by_machine = isinstance(error, _OF_MACHINE) or name == _OUT_OF_GPU_MEMORY
        return cls(name, str(error), "".join(traceback.format_exception(error)), by_machine)

    @classmethod
    def died(cls, how: str) -> Failure:
        """Return the failure of a job whose worker died."""
        return cls(WORKER_DIED, f"worker died: {how}", by_machine=True)

    @property
    def reason(self) -> str:
        """The failure in one line."""
        if self.error == WORKER_DIED:
            return self.message
        return f"{self.error}: {self.message}" if self.message else self.error


class Executor(Protocol):
    """Runs tasks in processes; a task that loses its process ends, and the others go on."""

    @property
    def n(self) -> int:
        """Number of tasks that run at a time."""

    def memory_bytes(self, device: str) -> int:
        """Return the memory of a device that a task may use."""

    def submit(self, task: bytes) -> Future[bytes]:
        """Start a task of `pack`; the result is that of `perform`.

        Raises:
            StoreError: no task has a result any more.
        """

    def why(self, error: Exception) -> Failure | StoreError:
        """Return why a task has no result; a StoreError: no other will have one."""

    def close(self) -> None:
        """End all processes at once, whatever they do."""


def pack(function: Callable[[Job], Iterable[Part]], job: Job) -> bytes:
    """Return a task for `perform`; the job is pickled apart, for it may hold components of plugins."""
    own = registry.interactive()
    content = _dumps((own, function, job), by_value=bool(own))
    return pickle.dumps((registry.loaded_plugins(), content))


def _dumps(value: object, *, by_value: bool) -> bytes:
    """Pickle a value; classes that no other process can import go along by value."""
    if not by_value:
        return pickle.dumps(value)
    import cloudpickle

    dumped: bytes = cloudpickle.dumps(value)
    return dumped


def perform(task: bytes) -> bytes:
    """Run a task, and return its parts, which `unpack` reads; an exception that ends it is the last part."""
    plugins, content = pickle.loads(task)
    parts = []
    try:
        registry.load_the_same(plugins)
        own, function, job = pickle.loads(content)
        for section, name, cls in own:  # classes of a notebook go along by value
            registry.register(section, name)(cls)
        for part in function(job):
            parts.append(_dumps(part, by_value=bool(own)))
    except Exception as error:
        parts.append(pickle.dumps(Failure.of(error)))
    return pickle.dumps(parts)


def unpack(result: bytes) -> list[Any]:
    """Return the parts of a task, of which the last may be a `Failure`."""
    return [pickle.loads(part) for part in pickle.loads(result)]


def stdout_to_stderr() -> None:
    """Send what a worker prints to stderr, line by line: a worker may be killed."""
    os.dup2(2, 1)
    sys.stdout = sys.stderr
