"""Executors without worker processes, whose start takes a second: for tests of what a study does."""

from __future__ import annotations

import os
import pickle
import signal
import threading
import warnings
from dataclasses import dataclass
from typing import NoReturn

from dse.study.executors import Lost, Post
from dse.study.executors.loky import memory_bytes
from dse.study.executors.work import Failure, Message, perform


@dataclass
class InProcess:
    """Runs each task to its end in this process when it is submitted; `n` is what a plan counts with."""

    n: int

    def memory_bytes(self, device: str) -> int:
        return 3 * memory_bytes(device) // (4 * self.n)

    def submit(self, task: bytes, post: Post, lost: Lost) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # as in a worker, which has no filters of pytest
            self._perform(task, post, lost)

    def _perform(self, task: bytes, post: Post, lost: Lost) -> None:
        perform(task, post)

    def close(self) -> None:
        pass


class Forked(InProcess):
    """The same in a fork of this process, which may be killed, and which ends when this process does."""

    def _perform(self, task: bytes, post: Post, lost: Lost) -> None:
        ours, theirs = os.pipe()
        of_parent, held = os.pipe()  # at its end, the parent has ended
        if not (child := os.fork()):
            os.close(held)
            _work(task, theirs, of_parent)
        os.close(theirs)
        os.close(of_parent)
        try:
            with os.fdopen(ours, "rb") as pipe:
                while pipe.peek(1):
                    post(pickle.load(pipe))
            _, status = os.waitpid(child, 0)
        except BaseException:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            raise
        finally:
            os.close(held)
        if os.WIFSIGNALED(status):
            lost(Failure.died(f"signal {os.WTERMSIG(status)}"))


def _work(task: bytes, results: int, of_parent: int) -> NoReturn:
    """Perform a task in a fork; signals that its parent catches end it, but for Ctrl-C."""
    try:
        for number in (signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_DFL)
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        threading.Thread(target=lambda: os._exit(len(os.read(of_parent, 1))), daemon=True).start()
        with os.fdopen(results, "wb") as pipe:

            def send(message: Message) -> None:
                pickle.dump(message, pipe)
                pipe.flush()

            perform(task, send)
    finally:
        os._exit(0)
