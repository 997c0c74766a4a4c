"""Executors without worker processes, whose start takes a second: for tests of what a study does."""

from __future__ import annotations

import os
import signal
import threading
import warnings
from concurrent.futures import Future
from dataclasses import dataclass

from dse.study.executors.loky import memory_bytes
from dse.study.executors.work import Failure, perform


class Died(Exception):
    """A fork was killed; the text says how."""


@dataclass
class InProcess:
    """Runs each task to its end in this process when it is submitted; `n` is what a plan counts with."""

    n: int

    def memory_bytes(self, device: str) -> int:
        return 3 * memory_bytes(device) // (4 * self.n)

    def submit(self, task: bytes) -> Future[bytes]:
        future = Future()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # as in a worker, which has no filters of pytest
            try:
                future.set_result(self._perform(task))
            except Died as error:
                future.set_exception(error)
        return future

    def why(self, error: Exception) -> Failure:
        return Failure.died(str(error)) if isinstance(error, Died) else Failure.of(error)

    def _perform(self, task: bytes) -> bytes:
        return perform(task)

    def close(self) -> None:
        pass


class Forked(InProcess):
    """The same in a fork of this process, which may be killed, and which ends when this process does."""

    def _perform(self, task: bytes) -> bytes:
        ours, theirs = os.pipe()
        of_parent, held = os.pipe()  # at its end, the parent has ended
        if not (child := os.fork()):
            os.close(held)
            _work(task, theirs, of_parent)
        os.close(theirs)
        os.close(of_parent)
        try:
            with os.fdopen(ours, "rb") as pipe:
                result = pipe.read()
            _, status = os.waitpid(child, 0)
        except BaseException:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            raise
        finally:
            os.close(held)
        if os.WIFSIGNALED(status):
            raise Died(f"signal {os.WTERMSIG(status)}")
        return result


def _work(task, results, of_parent):
    """Perform a task in a fork; signals that its parent catches end it, but for Ctrl-C."""
    try:
        for number in (signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_DFL)
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        threading.Thread(target=lambda: os._exit(len(os.read(of_parent, 1))), daemon=True).start()
        with os.fdopen(results, "wb") as pipe:
            pipe.write(perform(task))
    finally:
        os._exit(0)
