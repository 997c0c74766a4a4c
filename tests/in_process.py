"""Executors without worker processes, whose start takes a second: for tests of what a study does."""

from __future__ import annotations

import os
import pickle
import signal
import threading
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import NoReturn

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
    """The same in a fork of this process, which may be killed, and which ends when this process does."""

    def _performed(self, task: bytes, post: Post) -> list[bytes] | Failure:
        ours, theirs = os.pipe()
        of_parent, held = os.pipe()  # at its end, the parent has ended
        if not (child := os.fork()):
            os.close(held)
            _work(task, theirs, of_parent)
        os.close(theirs)
        os.close(of_parent)
        messages: list[bytes] = []
        try:
            with os.fdopen(ours, "rb") as pipe:
                while pipe.peek(1):
                    messages.append(pickle.load(pipe))
                    post(messages[-1])
            _, status = os.waitpid(child, 0)
        except BaseException:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            raise
        finally:
            os.close(held)
        return Failure.died(f"signal {os.WTERMSIG(status)}") if os.WIFSIGNALED(status) else messages


def _work(task: bytes, results: int, of_parent: int) -> NoReturn:
    """Perform a task in a fork; signals that its parent catches end it, but for Ctrl-C."""
    try:
        for number in (signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_DFL)
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        threading.Thread(target=lambda: os._exit(len(os.read(of_parent, 1))), daemon=True).start()
        with os.fdopen(results, "wb") as pipe:

            def send(message: bytes) -> None:
                pickle.dump(message, pipe)
                pipe.flush()

            perform(task, send)
    finally:
        os._exit(0)
