"""What a worker process does: load the plugins, run a job, send its parts as they come.

A job is a function that yields parts. Each part is a message, sent at once, as are its begin and its end.
"""

from __future__ import annotations

import os
import pickle
import sys
import traceback
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TypeVar

from dse import registry
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


@dataclass(frozen=True)
class Message:
    """That a task has begun, a part of its job, or its end.

    task: its number. part: pickled; of the end, a `Failure`; b'': none.
    """

    task: int
    part: bytes = b""
    is_last: bool = False


def pack(number: int, function: Callable[[Job], Iterable[Part]], job: Job) -> bytes:
    """Return a task for `perform`; the job is pickled apart, for it may hold components of plugins."""
    own = registry.interactive()
    content = _dumps((own, function, job), by_value=bool(own))
    return pickle.dumps((number, registry.loaded_plugins(), content))


def _dumps(value: object, *, by_value: bool) -> bytes:
    """Pickle a value; classes that no other process can import go along by value."""
    if not by_value:
        return pickle.dumps(value)
    import cloudpickle

    dumped: bytes = cloudpickle.dumps(value)
    return dumped


def perform(task: bytes, post: Callable[[Message], object]) -> None:
    """Run a task, and post each message; an exception that ends the job is the part of the last one."""
    number, plugins, content = pickle.loads(task)
    post(Message(number))
    failure = b""
    try:
        registry.load_the_same(plugins)
        own, function, job = pickle.loads(content)
        for section, name, cls in own:  # classes of a notebook go along by value
            registry.register(section, name)(cls)
        for part in function(job):
            post(Message(number, _dumps(part, by_value=bool(own))))
    except Exception as error:
        failure = pickle.dumps(Failure.of(error))
    post(Message(number, failure, is_last=True))


def stdout_to_stderr() -> None:
    """Send what a worker prints to stderr, line by line: a worker may be killed."""
    os.dup2(2, 1)
    sys.stdout = sys.stderr
