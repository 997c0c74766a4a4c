"""Signals that end a command as Ctrl-C does: what has finished is written first."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType


class Stopped(KeyboardInterrupt):
    """A signal other than that of Ctrl-C; code: exit code."""

    code: int


@contextlib.contextmanager
def by_signals() -> Iterator[None]:
    """Let SIGTERM and SIGHUP raise `Stopped` in the block, once; one that is ignored (nohup) stays so."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)}
    caught = [number for number, handler in before.items() if handler is signal.SIG_DFL]

    def stop(number: int, _: FrameType | None) -> None:
        for each in caught:
            signal.signal(each, signal.SIG_IGN)
        name = signal.Signals(number).name
        stopped = Stopped(
            f"stopped by {name}; finished trials and the tables are written, and the same command resumes "
            "the study"
        )
        stopped.code = 128 + number
        raise stopped

    for number in caught:
        signal.signal(number, stop)
    try:
        yield
    finally:
        for number in caught:
            signal.signal(number, before[number])
