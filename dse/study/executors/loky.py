"""Worker processes on this machine: joblib's loky, one executor of one worker per slot.

A shared pool ends every running job when one worker dies, and hides which. Here a dead worker breaks its own
executor, which is replaced. The worker and its parent share a socket: it brings messages, and when the
parent ends, however it ends, the worker reads its end and ends too. Ctrl-C reaches the parent alone. POSIX.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import queue
import re
import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from pathlib import Path

from dse.study.executors import Lost, Post
from dse.study.executors.work import THREADS, Failure, Message, perform, stdout_to_stderr

_GRACE_S = 0.2
_EXIT_CODE = re.compile(r"\((-?\d+)\)")
# Where Linux states the memory limit of a container: cgroup v2, then v1.
_CONTAINER_LIMITS = ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes")


class Loky:
    """Up to `n` worker processes of one thread each, started when first needed."""

    def __init__(self, n: int) -> None:
        self._n = n
        self._slots: list[_Slot] = []
        self._idle: list[_Slot] = []

    @property
    def n(self) -> int:
        """Number of tasks that run at a time."""
        return self._n

    def memory_bytes(self, device: str) -> int:
        """Return a worker's equal part of three quarters of the memory."""
        return 3 * memory_bytes(device) // (4 * self._n)

    def submit(self, task: bytes, post: Post, lost: Lost) -> None:
        """Start a task in an idle worker or a new one."""
        for slot in [slot for slot in self._slots if slot.is_lost]:
            slot.close()
            self._slots.remove(slot)
        while True:
            if not self._idle:
                self._slots.append(_Slot(self._idle))
            slot = self._idle.pop() if self._idle else self._slots[-1]
            try:
                slot.submit(task, post, lost)
                return
            except BrokenProcessPool:  # it died while idle
                slot.close()
                self._slots.remove(slot)

    def close(self) -> None:
        """End all workers at once."""
        for slot in self._slots:
            slot.close()
        self._slots.clear()
        self._idle.clear()


class _Slot:
    """An executor of one worker, which it starts with its first task; it is among `idle` after each task."""

    def __init__(self, idle: list[_Slot]) -> None:
        from joblib.externals.loky import ProcessPoolExecutor

        self.is_lost = False
        self._free = partial(idle.append, self)
        self._ours, self._theirs = multiprocessing.Pipe()
        self._post: Post = _ignore
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        # faulthandler, which loky would enable, writes a stack among the lines of progress.
        env = {**THREADS, "PYTHONFAULTHANDLER": os.environ.get("PYTHONFAULTHANDLER", "")}
        self._executor = ProcessPoolExecutor(1, initializer=_begin, initargs=(self._theirs,), env=env)

    def submit(self, task: bytes, post: Post, lost: Lost) -> None:
        """Start a task, after that which sends its last message now."""
        self._post = post

        def end(future: Future[None]) -> None:
            error = future.exception()
            if isinstance(error, BrokenProcessPool):
                # Whoever kills a process tree may reach the worker first: blame no job if we die too.
                time.sleep(_GRACE_S)
                self._theirs.close()  # the last copy: the reader takes what is left, and the end
                self._reader.join()
                self.is_lost = True
                lost(Failure.died(_how(error)))
            elif error is not None:
                self._free()
                lost(Failure.of(error))

        with without_ctrl_c():
            self._executor.submit(_run, task).add_done_callback(end)

    def close(self) -> None:
        self._post = _ignore
        with contextlib.suppress(queue.Empty):  # loky would look for tasks that `kill_workers` has dropped
            while True:
                self._executor._work_ids.get_nowait()
        self._executor.shutdown(wait=True, kill_workers=True)
        self._theirs.close()
        self._reader.join()
        self._ours.close()

    def _read(self) -> None:
        with contextlib.suppress(EOFError, OSError):
            while True:
                message: Message = self._ours.recv()
                post = self._post  # not as it was when the wait began
                if message.is_last:
                    self._free()
                post(message)


def _how(error: BrokenProcessPool) -> str:
    """Return how a worker died."""
    code = _EXIT_CODE.search(str(error))
    if code is None:
        return str(error).partition("\n")[0]
    number = int(code[1])
    return f"signal {-number}" if number < 0 else f"exit code {number}"


def _ignore(message: Message) -> None:
    pass


@contextlib.contextmanager
def without_ctrl_c() -> Iterator[None]:
    """Start processes that never see SIGINT: they inherit that it is blocked."""
    resource_tracker.ensure_running()  # else it starts with the worker, and unblocks SIGINT
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


_to_parent: list[Connection] = []  # of a worker: one


def _begin(connection: Connection) -> None:
    """Prepare a worker: its output goes to stderr, and it ends when its parent does."""
    _to_parent.append(connection)
    stdout_to_stderr()
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    # With psutil, loky replaces a worker that has grown by 300 MB: a prepared data set is no leak.
    from joblib.externals.loky import process_executor

    process_executor._USE_PSUTIL = False
    threading.Thread(target=_watch, args=(connection,), daemon=True).start()


def _watch(connection: Connection) -> None:
    with contextlib.suppress(EOFError, OSError):
        connection.recv_bytes()
    os._exit(0)


def _run(task: bytes) -> None:
    perform(task, _to_parent[0].send)


def clear(process: int) -> None:
    """Remove the semaphores of a coordinator that was killed with all that would have done so (Linux)."""
    if not Path(f"/proc/{process}").exists():
        for semaphore in Path("/dev/shm").glob(f"sem.loky-{process}-*"):
            with contextlib.suppress(OSError):  # of another user, who has this number now
                semaphore.unlink()


def memory_bytes(device: str) -> int:
    """Return a device's memory in bytes; in a container, at most the container's limit."""
    if device == "cuda":
        import torch

        if torch.cuda.is_available():
            return int(torch.cuda.get_device_properties(0).total_memory)
    machine = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    limits = [path.read_text().strip() for path in map(Path, _CONTAINER_LIMITS) if path.is_file()]
    return min([machine, *(int(limit) for limit in limits if limit.isdecimal())])
