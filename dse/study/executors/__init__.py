"""Executors of jobs: where the work of a study runs.

Each is built on a `concurrent.futures.Executor`: joblib's loky on this machine, Dask on many. `Executor`
is what `dse.study.workers` needs of one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from dse.store import StoreError
from dse.study.executors.work import Failure, Message

Post = Callable[[Message], None]
"""Takes a message of `dse.study.executors.work.perform`, on any thread."""

Lost = Callable[[Failure | StoreError], None]
"""Takes why a task will not send its last message, on any thread; a StoreError: nor will any other."""


class Executor(Protocol):
    """Runs tasks in processes; a task that loses its process ends, and the others go on."""

    @property
    def n(self) -> int:
        """Number of tasks that run at a time."""

    def memory_bytes(self, device: str) -> int:
        """Return the memory of a device that a task may use."""

    def submit(self, task: bytes, post: Post, lost: Lost) -> None:
        """Start a task of `dse.study.executors.work.pack`.

        Args:
            task: the packed function and job.
            post: takes each message of the task as it arrives.
            lost: called where the task has lost its process, after all that it sent was posted.
        """

    def close(self) -> None:
        """End all processes at once, whatever they do."""
