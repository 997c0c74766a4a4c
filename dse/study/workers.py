"""A function over jobs, in worker processes: one job at a time and one thread each.

A job yields its result in parts, which arrive when it ends. A worker that dies (killed for memory,
segmentation fault) costs the job that it was running and nothing else: the job's result is a `Failure` that
says how it died. What the job has finished before is on the disk.
"""

from __future__ import annotations

import contextlib
import itertools
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from typing import Any, TypeVar

from dse.store import StoreError
from dse.study.executors.loky import Loky
from dse.study.executors.work import Executor, Failure, pack, unpack

Job = TypeVar("Job")
Part = TypeVar("Part")

_GLANCE_S = 0.5  # between looks at what running jobs say
# How often work is begun that the machine ends, before it is left to the next session: beside others, beside
# others again, and alone with the whole machine.
_ATTEMPTS = 3


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
        """Yield every part that the function yields for a job, with its job, when the job has ended.

        A job that ends early, by an exception or by its worker's death, ends with a `Failure`. What a running
        job writes to its `progress_file` is yielded meanwhile.

        Args:
            function: importable by name; it is called in a worker.
            jobs: taken one by one as workers become free; pickled, so keep them small.

        Raises:
            OutOfTime: the time is over; running jobs are ended.
            StoreError: the executor is lost.
        """
        waiting = iter(jobs)
        running: dict[Future[bytes], Job] = {}
        heard = ""
        try:
            while True:
                for job in itertools.islice(waiting, max(0, self.n - len(running))):
                    running[self._executor.submit(pack(function, job))] = job
                if not running:
                    return
                left_s = self.left_s
                glance_s = _GLANCE_S if left_s is None else min(_GLANCE_S, left_s)
                ended = wait(running, glance_s, FIRST_COMPLETED).done
                if not ended and left_s == 0:
                    raise OutOfTime
                for future in ended:
                    job = running.pop(future)
                    yield from ((job, part) for part in self._parts(future))
                for job in running.values():
                    with contextlib.suppress(OSError, AttributeError):
                        text: Any = job.progress_file.read_text("utf-8")  # type: ignore[attr-defined]
                        if text and text != heard:
                            heard = text
                            yield job, text
        finally:
            if running:  # the caller has stopped: nobody reads the results of running jobs
                self._executor.close()

    def attempts(
        self,
        function: Callable[[Job], Iterable[Part]],
        jobs: Sequence[Job],
        admitted: Callable[[Iterable[Job]], Iterable[Job]] = iter,
    ) -> Iterator[tuple[Job, Part | Failure, list[Job] | None]]:
        """Yield what `stream` does, each with a list that takes jobs to be tried again; None: it is over.

        Args:
            function: as of `stream`.
            jobs: at first; what the machine ended is tried again, at last one job at a time.
            admitted: returns those of some jobs that begin, as workers become free.
        """
        waiting = list(jobs)
        for attempt in range(_ATTEMPTS if waiting else 0):
            again = None if attempt == _ATTEMPTS - 1 else list[Job]()
            for at_once in [admitted(waiting)] if again is not None else ([job] for job in admitted(waiting)):
                yield from ((job, part, again) for job, part in self.stream(function, at_once))
            if not again:
                return
            waiting = again

    def _parts(self, ended: Future[bytes]) -> list[Any]:
        """Return the parts of a task that has ended."""
        try:
            return unpack(ended.result())
        except Exception as error:
            why = self._executor.why(error)
            if isinstance(why, StoreError):
                raise why from error
            return [why]
