"""Executors of jobs: where the work of a study runs.

Each is built on a `concurrent.futures.Executor`: joblib's loky on this machine, Dask on many. `Executor`
is what `dse.study.workers` needs of one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from dse.study.executors.work import Failure

Post = Callable[[bytes], None]
"""Takes a message of `dse.study.executors.work.perform`, on any thread."""


class Executor(Protocol):
    """Runs tasks in processes; a task that loses its process ends, and the others go on."""

    @property
    def n(self) -> int:
        """Number of tasks that run at a time."""

    def memory_bytes(self, device: str) -> int:
        """Return the memory of a device that a task may use."""

    def submit(self, task: bytes, post: Post, ended: Callable[[], None]) -> object:
        """Start a task of `dse.study.executors.work.pack` and return its handle.

        Args:
            task: the packed function and job.
            post: takes each message of the task as it arrives.
            ended: called on any thread when the task has ended; every message that a process sent before it
                died is posted by then.
        """

    def result(self, handle: object) -> list[bytes] | Failure:
        """Return all messages of a task that has ended, or why there is no result."""

    def close(self) -> None:
        """End all processes at once, whatever they do."""
