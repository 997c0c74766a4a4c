"""The progress of a running study, on stderr: a bar with the time left, or one line per run."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Protocol

from dse.study.time_left import TimeLeft
from dse.text import one_line

# Shortest time between two lines of a log about the work in progress.
_DOING_S = 10.0


class Progress(Protocol):
    """A reporter of progress; the number of expected runs may grow."""

    def expect(self, n_runs: int) -> None:
        """Announce that many more training runs."""

    def plan(self, work: Sequence[float]) -> None:
        """Announce the estimated work of runs that are about to be trained, in any unit."""

    def advance(self, text: str, work: float = 0.0) -> None:
        """Report the end of a run; `text` names it and its result, `work` is its planned work."""

    def doing(self, text: str) -> None:
        """Report the work in progress; each text replaces the previous one."""

    def note(self, text: str) -> None:
        """Report an important event: a warning, a stage."""


@contextmanager
def shown(enabled: bool, n_workers: int = 1) -> Iterator[Progress]:
    """Yield the reporter of progress: a bar on a terminal, lines elsewhere, or silence.

    Args:
        enabled: whether to show progress.
        n_workers: workers that train at a time.
    """
    if not enabled:
        yield Silent()
    elif sys.stderr.isatty():
        with _bar(n_workers) as bar:
            yield bar
    else:
        yield Lines(n_workers)


class Silent:
    """Says nothing."""

    def expect(self, n_runs: int) -> None:
        """Say nothing."""

    def plan(self, work: Sequence[float]) -> None:
        """Say nothing."""

    def advance(self, text: str, work: float = 0.0) -> None:
        """Say nothing."""

    def doing(self, text: str) -> None:
        """Say nothing."""

    def note(self, text: str) -> None:
        """Say nothing."""


class Lines:
    """One line per run, for logs."""

    def __init__(self, n_workers: int = 1) -> None:
        self._last_doing_s = time.monotonic()
        self._left = TimeLeft(n_workers, self._last_doing_s)

    def expect(self, n_runs: int) -> None:
        """Raise the number of runs expected."""
        self._left.expect(n_runs)

    def plan(self, work: Sequence[float]) -> None:
        """Add the work of runs that are about to be trained."""
        self._left.plan(work)

    def advance(self, text: str, work: float = 0.0) -> None:
        """Print the run and, once there is an estimate, the time left."""
        now_s = time.monotonic()
        self._left.end(now_s, work)
        left_s = self._left.seconds(now_s)
        estimate = "" if left_s is None else f", about {duration(left_s)} left"
        self.note(f"{self._left.n_ended}/{self._left.n_expected} {text}{estimate}")

    def doing(self, text: str) -> None:
        """Print a line, now and then."""
        now_s = time.monotonic()
        if now_s - self._last_doing_s >= _DOING_S:
            self._last_doing_s = now_s
            self.note(text)

    def note(self, text: str) -> None:
        """Print a line."""
        # In one piece: `print` writes the line's end apart, and Ctrl-C may fall between the two.
        sys.stderr.write(f"{one_line(text)}\n")
        sys.stderr.flush()


@contextmanager
def _bar(n_workers: int) -> Iterator[Progress]:
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
    from rich.progress import Progress as Rich

    columns = (
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[left]}"),
        TextColumn("{task.description}"),
    )
    left = TimeLeft(n_workers, time.monotonic())
    with Rich(*columns, console=Console(stderr=True)) as rich:
        task = rich.add_task("preparing", total=0, left="")

        class Bar:
            def expect(self, n_runs: int) -> None:
                left.expect(n_runs)
                rich.update(task, total=left.n_expected)

            def plan(self, work: Sequence[float]) -> None:
                left.plan(work)

            def advance(self, text: str, work: float = 0.0) -> None:
                now_s = time.monotonic()
                left.end(now_s, work)
                left_s = left.seconds(now_s)
                estimate = "" if left_s is None else f"about {duration(left_s)} left"
                rich.update(task, advance=1, description=escape(one_line(text)), left=estimate)

            def doing(self, text: str) -> None:
                rich.update(task, description=escape(one_line(text)))

            def note(self, text: str) -> None:
                rich.console.print(one_line(text), markup=False, highlight=False)

        yield Bar()


def duration(seconds: float) -> str:
    """Return a duration in words, as finely as an estimate allows: 40 s, 7 min, 2 h 10 min."""
    if seconds < 95:
        return f"{max(10, 10 * round(seconds / 10))} s"
    minutes = round(seconds / 60)
    if minutes < 60:
        return f"{minutes} min"
    hours, minutes = divmod(10 * round(minutes / 10), 60)
    return f"{hours} h {minutes} min" if minutes else f"{hours} h"
