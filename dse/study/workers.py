"""A function over jobs, in worker processes: one job at a time and one thread each.

A job may yield its result in parts, which arrive at once: parts that arrived before the job ended early stay
valid. A worker that dies (killed for memory, segmentation fault) costs the job that it was running and
nothing else: the job's result is a `Failure` that says how it died.
"""

from __future__ import annotations

import functools
import itertools
import pickle
import queue
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

from dse.study.executors import Executor
from dse.study.executors.loky import Loky
from dse.study.executors.work import Failure, Message, pack, part_of

Job = TypeVar("Job")
Result = TypeVar("Result")
Part = TypeVar("Part")

_STARTS = 3
"""Workers that may die one after the other before they begin a job."""


class Workers:
    """The workers of an executor, ended with the `with` block; one `map` or `stream` at a time.

    Args:
        n: number of worker processes on this machine.
        executor: instead of them.

    Raises:
        ValueError: n is below 1.
    """

    def __init__(self, n: int, executor: Executor | None = None) -> None:
        if n < 1:
            raise ValueError(f"jobs must be at least 1, got {n}")
        self._executor = executor or Loky(n)
        self._numbers = itertools.count()

    @property
    def n(self) -> int:
        """Number of jobs that run at a time."""
        return self._executor.n

    def memory_budget(self, gib: float | None, device: str) -> int:
        """Return the bytes that a worker may use: as stated, else what the executor has for each."""
        return int(gib * 2**30) if gib is not None else self._executor.memory_bytes(device)

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.close()

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
        inbox: queue.SimpleQueue[bytes | int] = queue.SimpleQueue()  # messages; numbers of ended tasks
        running: dict[int, _Task[Job]] = {}

        def start(job: Job, n_starts: int) -> None:
            number = next(self._numbers)
            handle = self._executor.submit(pack(number, function, job), inbox.put, lambda: inbox.put(number))
            running[number] = _Task(job, handle, n_starts)

        try:
            while True:
                for job in itertools.islice(waiting, max(0, self.n - len(running))):
                    start(job, 1)
                if not running:
                    return
                arrived = inbox.get()
                if isinstance(arrived, bytes):
                    message: Message = pickle.loads(arrived)
                    if (sender := running.get(message.task)) is not None:  # else it has ended
                        yield from ((sender.job, part) for part in sender.parts(message))
                    continue
                if (task := running.pop(arrived, None)) is None:
                    continue
                messages = self._executor.result(task.handle)
                if isinstance(messages, Failure):
                    if task.n_received or task.n_starts == _STARTS:
                        yield task.job, messages
                    else:  # no job is blamed for a worker that died before it began
                        start(task.job, task.n_starts + 1)
                    continue
                for each in map(pickle.loads, messages):
                    yield from ((task.job, part) for part in task.parts(each))
        finally:
            if running:  # the caller has stopped: nobody reads the results of running jobs
                self._executor.close()


def _once(function: Callable[[Job], Result], job: Job) -> Iterator[Result]:
    yield function(job)


@dataclass
class _Task(Generic[Job]):
    """A job that runs.

    n_starts: workers that have begun or died with it.
    received: attempt -> number of its messages that have arrived.
    """

    job: Job
    handle: object
    n_starts: int
    received: dict[str, int] = field(default_factory=dict)

    @property
    def n_received(self) -> int:
        return sum(self.received.values())

    def parts(self, message: Message) -> Iterator[Any]:
        """Yield the part in a message, unless it came before or the message is the first of its attempt."""
        if message.number == self.received.get(message.attempt, 0):
            self.received[message.attempt] = message.number + 1
            if message.number:
                yield part_of(message)
