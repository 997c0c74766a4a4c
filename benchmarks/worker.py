"""What is measured, in a process of its own, so that none disturbs the next; it may be another environment's.

The parent asks by a line of JSON and the worker answers by one. Only the standard library is imported here.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")


class NotInstalled(RuntimeError):
    """The worker's Python lacks the framework."""


class Worker:
    """A running `python -m module *arguments` that calls `serve`, on one thread.

    Raises:
        NotInstalled: the module or what it measures cannot be imported there.
        RuntimeError: the worker ended; the message is the last line of what it wrote.
    """

    def __init__(self, python: str, module: str, *arguments: str) -> None:
        self._said = tempfile.TemporaryFile("w+")
        try:
            self._process = subprocess.Popen(
                [python, "-m", module, *arguments],
                cwd=ROOT,
                env={**os.environ, **dict.fromkeys(THREADS, "1")},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._said,
                text=True,
            )
        except OSError as error:
            self._said.close()
            raise NotInstalled(f"{python} cannot be run") from error

    def __enter__(self) -> Worker:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.kill()
        self._process.communicate()
        self._said.close()

    def ask(self, name: str, *arguments: Any) -> Any:
        """Return the answer of the worker's function `name`."""
        assert self._process.stdin and self._process.stdout
        with contextlib.suppress(BrokenPipeError):  # it has ended: the empty answer says so
            self._process.stdin.write(json.dumps([name, *arguments]) + "\n")
            self._process.stdin.flush()
        answer = self._process.stdout.readline()
        if answer:
            return json.loads(answer)
        self._process.wait()
        self._said.seek(0)
        last = ["", *self._said.read().strip().splitlines()][-1]
        missing = last.startswith(("ModuleNotFoundError", "ImportError"))
        raise NotInstalled(last) if missing else RuntimeError(last)


def serve(functions: Mapping[str, Callable[..., Any]]) -> None:
    """Answer the parent until it closes the pipe, on one core; whatever a library prints goes to stderr."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    with os.fdopen(os.dup(1), "w") as answers:
        os.dup2(2, 1)
        for line in sys.stdin:
            name, *arguments = json.loads(line)
            print(json.dumps(functions[name](*arguments)), file=answers, flush=True)


def cpu_seconds(function: Callable[[], Any], at_least_s: float, at_least: int) -> list[float]:
    """Return the CPU seconds of repeated calls, after one that is not counted."""
    function()
    found: list[float] = []
    while sum(found) < at_least_s or len(found) < at_least:
        began = time.process_time()
        function()
        found.append(time.process_time() - began)
    return found


def pythons(given: Sequence[str]) -> dict[str, str]:
    """Return {framework: interpreter} from words `framework=path`.

    Raises:
        ValueError: a word has no `=`.
    """
    for word in given:
        if "=" not in word:
            raise ValueError(f"--python must be FRAMEWORK=PATH, got {word}")
    return dict(word.split("=", 1) for word in given)
