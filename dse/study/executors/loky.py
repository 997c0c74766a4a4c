"""Worker processes on this machine: joblib's loky, one executor of one worker per task.

A shared pool ends every running job when one worker dies, and hides which. Here a dead worker breaks its own
executor, which is replaced. A worker ends when its parent does, however that ends. Ctrl-C reaches the parent
alone. POSIX.
"""

from __future__ import annotations

import contextlib
import os
import queue
import re
import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import resource_tracker
from pathlib import Path
from typing import TYPE_CHECKING

from dse.study.executors.work import THREADS, Failure, perform, stdout_to_stderr

if TYPE_CHECKING:
    from joblib.externals.loky import ProcessPoolExecutor

_GRACE_S = _WATCH_S = 0.2
_EXIT_CODE = re.compile(r"\((-?\d+)\)")
# Where Linux states the memory limit of a container: cgroup v2, then v1.
_CONTAINER_LIMITS = ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes")


class Loky:
    """Up to `n` worker processes of one thread each, started when first needed."""

    def __init__(self, n: int) -> None:
        self._n = n
        self._slots: dict[ProcessPoolExecutor, Future[bytes] | None] = {}  # of one worker each -> its task

    @property
    def n(self) -> int:
        """Number of tasks that run at a time."""
        return self._n

    def memory_bytes(self, device: str) -> int:
        """Return a worker's equal part of three quarters of the memory."""
        return 3 * memory_bytes(device) // (4 * self._n)

    def submit(self, task: bytes) -> Future[bytes]:
        """Start a task in an idle worker or a new one."""
        while True:
            slot = self._idle()
            try:
                with without_ctrl_c():
                    future: Future[bytes] = slot.submit(perform, task)
                self._slots[slot] = future
                return future
            except BrokenProcessPool:  # it died while idle
                self._end(slot)

    def _idle(self) -> ProcessPoolExecutor:
        for slot in [slot for slot, task in self._slots.items() if task is None or task.done()]:
            if all(map(_lives, slot._processes)):
                return slot
            self._end(slot)
        from joblib.externals.loky import ProcessPoolExecutor

        # faulthandler, which loky would enable, writes a stack among the lines of progress.
        env = {**THREADS, "PYTHONFAULTHANDLER": os.environ.get("PYTHONFAULTHANDLER", "")}
        slot = ProcessPoolExecutor(1, initializer=_begin, initargs=(os.getpid(),), env=env)
        self._slots[slot] = None
        return slot

    def why(self, error: Exception) -> Failure:
        """Return how a worker died, or what its task raised."""
        if not isinstance(error, BrokenProcessPool):
            return Failure.of(error)
        time.sleep(_GRACE_S)  # whoever kills a process tree may reach the worker first: blame no job then
        return Failure.died(_how(error))

    def _end(self, slot: ProcessPoolExecutor) -> None:
        self._slots.pop(slot)
        with contextlib.suppress(queue.Empty):  # loky would look for tasks that `kill_workers` has dropped
            while True:
                slot._work_ids.get_nowait()
        workers = list(slot._processes or ())  # None: one has died
        slot.shutdown(wait=True, kill_workers=True)
        for worker in filter(_lives, workers):  # without /proc, loky takes each for one that has ended
            os.kill(worker, signal.SIGKILL)
            os.waitid(os.P_PID, worker, os.WEXITED | os.WNOWAIT)

    def close(self) -> None:
        """End all workers at once."""
        for slot in list(self._slots):
            self._end(slot)


def _lives(process: int) -> bool:
    """Return whether a child lives; it is not waited for."""
    try:
        return os.waitid(os.P_PID, process, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None
    except ChildProcessError:
        return False


def _how(error: BrokenProcessPool) -> str:
    """Return how a worker died."""
    code = _EXIT_CODE.search(str(error))
    if code is None:
        return str(error).partition("\n")[0]
    number = int(code[1])
    return f"signal {-number}" if number < 0 else f"exit code {number}"


@contextlib.contextmanager
def without_ctrl_c() -> Iterator[None]:
    """Start processes that never see SIGINT: they inherit that it is blocked."""
    resource_tracker.ensure_running()  # else it starts with the worker, and unblocks SIGINT
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin(parent: int) -> None:
    """Prepare a worker: its output goes to stderr, and it ends when its parent does."""
    stdout_to_stderr()
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    # With psutil, loky replaces a worker that has grown by 300 MB: a prepared data set is no leak.
    from joblib.externals.loky import process_executor

    process_executor._USE_PSUTIL = False
    threading.Thread(target=_watch, args=(parent,), daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_WATCH_S)
    os._exit(0)


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
