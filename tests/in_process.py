"""Executors without worker processes, whose start takes a second: for tests of what a study does."""

from __future__ import annotations

import os
import pickle
import warnings
from collections.abc import Callable
from dataclasses import dataclass

from dse.study.executors.loky import memory_bytes
from dse.study.executors.work import Failure, perform

Post = Callable[[bytes], object]


@dataclass
class InProcess:
    """Runs each task to its end in this process when it is submitted; `n` is what a plan counts with."""

    n: int

    def memory_bytes(self, device: str) -> int:
        return 3 * memory_bytes(device) // (4 * self.n)

    def submit(self, task: bytes, post: Post, ended: Callable[[], None]) -> object:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # as in a worker, which has no filters of pytest
            messages = self._performed(task, post)
        ended()
        return messages

    def _performed(self, task: bytes, post: Post) -> list[bytes] | Failure:
        return perform(task, post)

    def result(self, handle: object) -> list[bytes] | Failure:
        assert isinstance(handle, list | Failure)
        return handle

    def close(self) -> None:
        pass


class Forked(InProcess):
    """The same in a fork of this process, which may be killed; for jobs that compute next to nothing."""

    def _performed(self, task: bytes, post: Post) -> list[bytes] | Failure:
        ours, theirs = os.pipe()
        if not (child := os.fork()):
            with os.fdopen(theirs, "wb") as pipe:

                def send(message: bytes) -> None:
                    pickle.dump(message, pipe)
                    pipe.flush()

                perform(task, send)
            os._exit(0)
        os.close(theirs)
        messages: list[bytes] = []
        with os.fdopen(ours, "rb") as pipe:
            while pipe.peek(1):
                messages.append(pickle.load(pipe))
                post(messages[-1])
        _, status = os.waitpid(child, 0)
        return Failure.died(f"signal {os.WTERMSIG(status)}") if os.WIFSIGNALED(status) else messages
