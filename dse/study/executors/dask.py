"""Workers of a Dask cluster: one that runs at an address, or one on this machine that ends with the study.

A task runs alone in its worker's process, from the folder that the coordinator runs in. What it finishes is
on the disk that coordinator and workers share: nothing stays on a worker. A task whose worker is lost ends;
whether it is begun again is decided by `dse.study.workers`, within its bound, so a cluster of ours has Dask
begin none again by itself.
"""

from __future__ import annotations

import contextlib
import importlib.metadata
import itertools
import logging
import os
import platform
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError, Future
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import dse
from dse.base.native.extras import MissingExtra
from dse.store import StoreError
from dse.study.executors.loky import memory_bytes, without_ctrl_c
from dse.study.executors.work import THREADS, Failure, perform, stdout_to_stderr

if TYPE_CHECKING:
    from distributed import Client, LocalCluster

_CONNECT_S = 20.0
_STARTS = 3
_REFRESH_S = 5.0
_OF_RESULTS = ("numpy", "numba")
"""Packages whose versions must be those of the coordinator: results are the same on all workers."""


class Unusable(Exception):
    """No cluster as it must be; one line says why."""


class Dask:
    """The workers of a cluster, one task at a time each.

    Args:
        n: number of workers of a cluster on this machine, where no other is named.
        address: of a scheduler.
        scheduler_file: that a scheduler wrote.
        shared: files and folders that every worker must see.

    Raises:
        MissingExtra: Dask is not installed.
        Unusable: no scheduler answers, or a worker has other versions or does not see a file.
        StoreError: workers on this machine end again and again while they start.
    """

    def __init__(
        self, n: int, address: str | None, scheduler_file: str | None, shared: Sequence[Path] = ()
    ) -> None:
        if find_spec("distributed") is None:
            raise MissingExtra("execution.backend dask needs distributed: pip install 'dse-spiking[dask]'")
        import dask
        from distributed import Client, LocalCluster

        self._logs = logging.getLogger("distributed")
        self._level = self._logs.level
        self._logs.setLevel(logging.CRITICAL)  # it tells of every lost worker, and so do we
        self._where = address or (f"scheduler file {scheduler_file}" if scheduler_file else "this machine")
        self._n_local = n
        self._cluster: LocalCluster | None = None
        self._futures: list[Future[bytes]] = []
        self._counted_s, self._counted = -_REFRESH_S, 0
        settings = {
            "distributed.scheduler.allowed-failures": 0,
            "distributed.worker.daemon": True,
            "logging": {"distributed": "critical"},
        }
        with without_ctrl_c(), dask.config.set(settings):
            for n_starts in itertools.count(1) if address is None and scheduler_file is None else ():
                try:
                    self._cluster = LocalCluster(
                        n_workers=n,
                        threads_per_worker=1,
                        memory_limit=memory_bytes("cpu") // n,
                        dashboard_address=None,
                        worker_dashboard_address=None,
                        scheduler_kwargs={"dashboard_address": ":0"},  # where its HTTP server listens
                        silence_logs=logging.CRITICAL,
                        env=THREADS,
                    )
                    break
                except (RuntimeError, OSError, TimeoutError) as error:  # a worker ended while it started
                    if n_starts == _STARTS:
                        self._logs.setLevel(self._level)
                        reason = f"{type(error).__name__}: {error}".splitlines()[0]
                        raise StoreError(
                            f"the Dask workers of this machine ended while they started ({reason}); finished "
                            "runs are kept: run the same command again"
                        ) from error
            self._client = self._connected(Client, address, scheduler_file)
        self._executor = self._client.get_executor(pure=False)
        try:
            self._check([Path.cwd(), *shared])
        except BaseException:
            self.close()
            raise

    def _connected(self, kind: type[Client], address: str | None, scheduler_file: str | None) -> Client:
        if scheduler_file is not None and not Path(scheduler_file).is_file():
            raise Unusable(f"{scheduler_file}: there is no such scheduler file")
        try:
            return kind(
                self._cluster or address,
                scheduler_file=None if self._cluster or address else scheduler_file,
                timeout=_CONNECT_S,
                set_as_default=False,
            )
        except (OSError, TimeoutError, ValueError) as error:
            self._logs.setLevel(self._level)
            raise Unusable(f"no Dask scheduler answers at {self._where} ({type(error).__name__})") from None

    @property
    def n(self) -> int:
        """Number of workers, at least 1: those that are lost may come back.

        Raises:
            StoreError: the scheduler is lost: a client that connects again does not find its tasks.
        """
        if self._client.status != "running":
            raise self._lost()
        if self._cluster is not None:
            return self._n_local
        if time.monotonic() - self._counted_s > _REFRESH_S:
            self._counted, self._counted_s = len(self._workers()), time.monotonic()
        return max(1, self._counted)

    def _workers(self) -> dict[str, Any]:
        with self._answering():
            return dict(self._client.scheduler_info(n_workers=-1)["workers"])

    @contextlib.contextmanager
    def _answering(self) -> Iterator[None]:
        try:
            yield
        except (OSError, TimeoutError, CancelledError, RuntimeError) as error:
            raise self._lost() from error

    def _lost(self) -> StoreError:
        return StoreError(
            f"the Dask scheduler at {self._where} is lost; finished runs are kept: run the same command again"
        )

    def memory_bytes(self, device: str) -> int:
        """Return three quarters of the least memory limit of a worker, or of this machine's memory."""
        limits = [int(each["memory_limit"]) for each in self._workers().values() if each["memory_limit"]]
        if device == "cpu" and limits:
            return 3 * min(limits) // 4
        return 3 * memory_bytes(device) // (4 * self.n)

    def _check(self, paths: Sequence[Path]) -> None:
        """Compare versions and files of the workers that there are with those here."""
        about, required = _of_this_process(), [str(path.absolute()) for path in paths]
        with self._answering():
            seen = self._client.run(_seen, required, on_error="return")
        for worker, answer in seen.items():
            if isinstance(answer, BaseException) and self._cluster is not None:
                continue  # it has ended, and another one like it is started
            if isinstance(answer, BaseException):
                raise Unusable(f"the Dask worker {worker} does not answer: {answer}")
            versions, missing = answer
            for name, here in about.items():
                if versions[name] != here:
                    raise _another(worker, name, versions[name], here)
            if missing:
                raise Unusable(f"the Dask worker {worker} does not see {missing[0]}; all must share it")

    def submit(self, task: bytes) -> Future[bytes]:
        """Start a task on a free worker, or on the first that becomes free."""
        about = _of_this_process(), os.getcwd(), os.environ.get("DSE_DATA", ""), self._cluster is not None
        with self._answering():
            future: Future[bytes] = self._executor.submit(_run, task, *about)
        self._futures = [future, *(x for x in self._futures if not x.done())]
        return future

    def why(self, error: Exception) -> Failure | StoreError:
        """Return why a task has failed; another version of a worker that has joined fails all."""
        from distributed import KilledWorker

        if isinstance(error, CancelledError):
            return self._lost()
        if isinstance(error, Unusable):
            return StoreError(str(error))
        if isinstance(error, KilledWorker):
            return Failure.died(f"Dask lost {getattr(error.last_worker, 'address', 'it')}")
        return Failure.of(error)

    def close(self) -> None:
        """Cancel what waits, and end a cluster of ours at once; other workers end the task they have."""
        for future in self._futures:
            future.cancel()
        with contextlib.suppress(Exception):
            if self._cluster is not None:
                self._cluster.sync(_kill, self._cluster)
            self._client.close(timeout=_REFRESH_S)
            if self._cluster is not None:
                self._cluster.close(timeout=_REFRESH_S)
        self._logs.setLevel(self._level)


async def _kill(cluster: LocalCluster) -> None:
    """Kill the workers at once; to close them takes as long as the tasks that they have."""
    for nanny in cluster.workers.values():
        nanny.auto_restart = False
        if nanny.process is not None and nanny.process.process is not None:
            await nanny.process.process.kill()


def _of_this_process() -> dict[str, str]:
    """Return name -> version of what results depend on."""
    versions = {name: importlib.metadata.version(name) for name in _OF_RESULTS}
    return {"python": ".".join(platform.python_version_tuple()[:2]), "dse": dse.__version__} | versions


def _seen(paths: Sequence[str]) -> tuple[dict[str, str], list[str]]:
    """Return the versions of a worker, and the paths that it does not see."""
    return _of_this_process(), [path for path in paths if not os.path.exists(path)]


def _another(worker: str, name: str, version: str, here: str) -> Unusable:
    return Unusable(f"the Dask worker {worker} has {name} {version}, not {here} as this process")


_alone = threading.Lock()  # the threads of a worker take turns


def _run(task: bytes, about: dict[str, str], folder: str, data: str, is_ours: bool) -> bytes:
    """Perform a task in a worker, from the coordinator's folder and with its recordings.

    The output of workers of ours is that of the coordinator, whose stdout is an answer.
    """
    from distributed import get_worker

    worker = get_worker()
    for name, version in _of_this_process().items():
        if about[name] != version:
            raise _another(worker.address, name, version, about[name])
    if is_ours:
        stdout_to_stderr()  # here, for a worker that is lost comes again as another process
    with _alone, contextlib.chdir(folder):
        os.environ["DSE_DATA"] = data
        return perform(task)
