"""What a worker process does: load the plugins, run a job, send its parts as they come.

A job is a function that yields parts. Each part is a message, sent at once; the result of the task is the
list of all messages, for whoever missed one.
"""

from __future__ import annotations

import os
import pickle
import secrets
import sys
import traceback
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, TypeVar

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
    """A part of a job, or its end.

    task: its number.
    attempt: of the run of the task that sent it; an executor may run a task again.
    number: counts the messages of the attempt; 0 tells that it has begun.
    """

    task: int
    attempt: str
    number: int
    part: bytes = b""


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


def perform(task: bytes, post: Callable[[bytes], object]) -> list[bytes]:
    """Run a task; post each message, and return all of them.

    An exception that ends the job is its last part, as a `Failure`.
    """
    number, plugins, content = pickle.loads(task)
    attempt = secrets.token_hex(8)
    messages: list[bytes] = []

    def send(part: bytes = b"") -> None:
        messages.append(pickle.dumps(Message(number, attempt, len(messages), part)))
        post(messages[-1])

    send()
    try:
        registry.load_the_same(plugins)
        own, function, job = pickle.loads(content)
        for section, name, cls in own:  # classes of a notebook go along by value
            registry.register(section, name)(cls)
        for part in function(job):
            send(_dumps(part, by_value=bool(own)))
    except Exception as error:
        send(pickle.dumps(Failure.of(error)))
    return messages


def part_of(message: Message) -> Any:
    """Return the part in a message."""
    return pickle.loads(message.part)


def stdout_to_stderr() -> None:
    """Send what a worker prints to stderr, line by line: a worker may be killed."""
    os.dup2(2, 1)
    sys.stdout = sys.stderr
