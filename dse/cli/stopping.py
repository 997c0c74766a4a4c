"""Signals that end a command as Ctrl-C does: what has finished is written first."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Iterator
from types import FrameType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

INTERRUPTED = 130
"""Exit code after Ctrl-C: 128 and the number of the signal."""
_AGAIN_S = 0.1


class Stopped(KeyboardInterrupt):
    """A signal other than that of Ctrl-C; code: exit code."""

    code: int


@contextlib.contextmanager
def by_signals() -> Iterator[None]:
    """Let SIGTERM and SIGHUP raise `Stopped` in the block; one that is ignored (nohup) stays so.

    While the block ends so, or by Ctrl-C, they change nothing. Where Python swallows an exception (in a
    destructor, in a fork), the signal comes again; so does Ctrl-C.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)}
    caught = [number for number, handler in before.items() if handler is signal.SIG_DFL]
    hook = sys.unraisablehook

    def stop(number: int, _: FrameType | None) -> None:
        if _ends(sys.exception()):
            return
        name = signal.Signals(number).name
        stopped = Stopped(
            f"stopped by {name}; finished trials and the tables are written, and the same command resumes "
            "the study"
        )
        stopped.code = 128 + number
        raise stopped

    def again(swallowed: UnraisableHookArgs) -> None:
        if not _ends(swallowed.exc_value):
            hook(swallowed)
            return
        number = getattr(swallowed.exc_value, "code", INTERRUPTED) - 128
        timer = threading.Timer(_AGAIN_S, os.kill, (os.getpid(), number))
        timer.daemon = True
        timer.start()

    for number in caught:
        signal.signal(number, stop)
    sys.unraisablehook = again
    try:
        yield
    finally:
        sys.unraisablehook = hook
        for number in caught:
            signal.signal(number, before[number])


def _ends(error: BaseException | None) -> bool:
    """Return whether an exception is one that a signal has raised, or came while one was handled."""
    return isinstance(error, KeyboardInterrupt) or (error is not None and _ends(error.__context__))
