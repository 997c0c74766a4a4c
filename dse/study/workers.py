"""A function over jobs, in worker processes: one job at a time and one thread each.

A job may yield its result in parts, which arrive at once: parts that arrived before the job ended early stay
valid. A worker that dies (killed for memory, segmentation fault) costs the job that it was running and
nothing else: the job's result is a `Failure` that says how it died.
"""

from __future__ import annotations

import itertools
import pickle
import queue
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

from dse.store import StoreError
from dse.study.executors import Executor
from dse.study.executors.loky import Loky
from dse.study.executors.work import Failure, Message, pack

Job = TypeVar("Job")
Part = TypeVar("Part")

_STARTS = 3
"""Workers that may die one after the other before they begin a job."""


class OutOfTime(Exception):
    """The time of a command is over."""


class Workers:
    """The workers of an executor, ended with the `with` block; one `stream` at a time.

    Args:
        n: number of worker processes on this machine.
        executor: instead of them.
        until_s: end of the command's time, as of `time.monotonic`; None: there is none.

    Raises:
        ValueError: n is below 1.
    """

    def __init__(self, n: int, executor: Executor | None = None, until_s: float | None = None) -> None:
        if n < 1:
            raise ValueError(f"jobs must be at least 1, got {n}")
        self._executor = executor or Loky(n)
        self._until_s = until_s
        self._numbers = itertools.count()

    @property
    def n(self) -> int:
        """Number of jobs that run at a time."""
        return self._executor.n

    @property
    def left_s(self) -> float | None:
        """The time left, not below 0; None: it has no end."""
        return None if self._until_s is None else max(self._until_s - time.monotonic(), 0.0)

    def memory_budget(self, gib: float | None, device: str) -> int:
        """Return the bytes that a worker may use: as stated, else what the executor has for each."""
        return int(gib * 2**30) if gib is not None else self._executor.memory_bytes(device)

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.close()

    def stream(
        self, function: Callable[[Job], Iterable[Part]], jobs: Iterable[Job]
    ) -> Iterator[tuple[Job, Part | Failure]]:
        """Yield every part that the function yields for a job, with its job, as soon as it arrives.

        A job that ends early, by an exception or by its worker's death, ends with a `Failure`; earlier parts
        stay valid.

        Args:
            function: importable by name; it is called in a worker.
            jobs: taken one by one as workers become free; pickled, so keep them small.

        Raises:
            OutOfTime: the time is over; running jobs are ended.
            StoreError: the executor is lost.
        """
        waiting = iter(jobs)
        inbox: queue.SimpleQueue[Message | tuple[int, Failure | StoreError]] = queue.SimpleQueue()
        running: dict[int, _Task[Job]] = {}

        def start(job: Job, n_starts: int) -> None:
            number = next(self._numbers)
            running[number] = _Task(job, n_starts)
            self._executor.submit(
                pack(number, function, job), inbox.put, lambda why: inbox.put((number, why))
            )

        try:
            while True:
                for job in itertools.islice(waiting, max(0, self.n - len(running))):
                    start(job, 1)
                if not running:
                    return
                try:
                    arrived = inbox.get(timeout=self.left_s)
                except queue.Empty:
                    raise OutOfTime from None
                if isinstance(arrived, Message):
                    if (sender := running.get(arrived.task)) is None:  # it has ended
                        continue
                    sender.has_begun = True
                    if arrived.is_last:
                        del running[arrived.task]
                    if arrived.part:
                        yield sender.job, pickle.loads(arrived.part)
                elif (task := running.pop(arrived[0], None)) is not None:
                    why = arrived[1]
                    if isinstance(why, StoreError):
                        raise why
                    if task.has_begun or task.n_starts == _STARTS:
                        yield task.job, why
                    else:  # no job is blamed for a worker that died before it began
                        start(task.job, task.n_starts + 1)
        finally:
            if running:  # the caller has stopped: nobody reads the results of running jobs
                self._executor.close()


@dataclass
class _Task(Generic[Job]):
    """A job that runs; n_starts: workers that have begun or died with it."""

    job: Job
    n_starts: int
    has_begun: bool = False
