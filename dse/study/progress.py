"""The progress of a running study, on stderr: a bar with the time left, or one line per run."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from dse.study.time_left import TimeLeft
from dse.text import one_line

if TYPE_CHECKING:
    import rich.progress

# Shortest time between two lines of a log about the work in progress.
_DOING_S = 10.0


class Progress:
    """A reporter of progress, which says nothing; the number of expected runs may grow."""

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


class Silent(Progress):
    """Says nothing."""


class _Estimating(Progress):
    """Knows the time left."""

    def __init__(self, n_workers: int) -> None:
        self._left = TimeLeft(n_workers, time.monotonic())

    def expect(self, n_runs: int) -> None:
        self._left.expect(n_runs)

    def plan(self, work: Sequence[float]) -> None:
        self._left.plan(work)

    def _ended(self, work: float) -> str:
        """Count a run, and return the time left in words; '' without an estimate."""
        now_s = time.monotonic()
        self._left.end(now_s, work)
        left_s = self._left.seconds(now_s)
        return "" if left_s is None else f"about {duration(left_s)} left"


class Lines(_Estimating):
    """One line per run, for logs."""

    def __init__(self, n_workers: int = 1) -> None:
        super().__init__(n_workers)
        self._last_doing_s = time.monotonic()

    def advance(self, text: str, work: float = 0.0) -> None:
        estimate = self._ended(work)
        self.note(f"{self._left.n_ended}/{self._left.n_expected} {text}{', ' if estimate else ''}{estimate}")

    def doing(self, text: str) -> None:
        """Print a line, now and then."""
        now_s = time.monotonic()
        if now_s - self._last_doing_s >= _DOING_S:
            self._last_doing_s = now_s
            self.note(text)

    def note(self, text: str) -> None:
        # In one piece: `print` writes the line's end apart, and Ctrl-C may fall between the two.
        sys.stderr.write(f"{one_line(text)}\n")
        sys.stderr.flush()


class _Bar(_Estimating):
    """A bar on a terminal."""

    def __init__(self, n_workers: int, rich: rich.progress.Progress) -> None:
        super().__init__(n_workers)
        self._rich, self._task = rich, rich.add_task("preparing", total=0, left="")

    def expect(self, n_runs: int) -> None:
        super().expect(n_runs)
        self._rich.update(self._task, total=self._left.n_expected)

    def advance(self, text: str, work: float = 0.0) -> None:
        estimate = self._ended(work)
        self._rich.update(self._task, advance=1, description=_escaped(text), left=estimate)

    def doing(self, text: str) -> None:
        self._rich.update(self._task, description=_escaped(text))

    def note(self, text: str) -> None:
        self._rich.console.print(one_line(text), markup=False, highlight=False)


def _escaped(text: str) -> str:
    from rich.markup import escape

    return escape(one_line(text))


@contextmanager
def shown(enabled: bool, n_workers: int = 1) -> Iterator[Progress]:
    """Yield the reporter of progress: a bar on a terminal, lines elsewhere, or silence.

    Args:
        enabled: whether to show progress.
        n_workers: workers that train at a time.
    """
    if not enabled or not sys.stderr.isatty():
        yield Lines(n_workers) if enabled else Silent()
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
    from rich.progress import Progress as Rich

    texts = (TextColumn("{task.fields[left]}"), TextColumn("{task.description}"))
    with Rich(BarColumn(), MofNCompleteColumn(), *texts, console=Console(stderr=True)) as rich:
        yield _Bar(n_workers, rich)


def duration(seconds: float) -> str:
    """Return a duration in words, as finely as an estimate allows: 40 s, 7 min, 2 h 10 min."""
    if seconds < 95:
        return f"{max(10, 10 * round(seconds / 10))} s"
    minutes = round(seconds / 60)
    if minutes < 60:
        return f"{minutes} min"
    hours, minutes = divmod(10 * round(minutes / 10), 60)
    return f"{hours} h {minutes} min" if minutes else f"{hours} h"
