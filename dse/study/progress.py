"""The progress of a running study, on stderr: a bar, or one line per run, with the time left."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from dse.base.text import one_line

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


_LEAST, _APART_S = 4, 1.0


class TimeLeft(Progress):
    """An estimate of the time left from the runs that have ended.

    Args:
        n_workers: workers that train at a time.
    """

    def __init__(self, n_workers: int) -> None:
        self._n_workers = n_workers
        self._ended_s: list[float] = []
        self._work: list[float] = []
        self._n_expected = 0
        self._n_planned = 0
        self._planned = 0.0

    @property
    def n_ended(self) -> int:
        """Number of runs that have ended."""
        return len(self._ended_s)

    @property
    def n_expected(self) -> int:
        """Number of all expected runs, including ended ones."""
        return self._n_expected

    def expect(self, n_runs: int) -> None:
        """Raise the number of runs that are expected."""
        self._n_expected += n_runs

    def plan(self, work: Sequence[float]) -> None:
        """Add the estimated work of runs that are about to be trained, in any unit."""
        self._n_planned += len(work)
        self._planned += sum(work)

    def end(self, at_s: float, work: float) -> None:
        """Add a run that has ended, with the work that was planned; 0 if it was never trained."""
        self._ended_s.append(at_s)
        self._work.append(work)

    def seconds(self, now_s: float) -> float | None:
        """Return the estimated time left, None before there is an estimate (`seconds_left`).

        Runs that are expected and not planned yet count as the mean of the planned ones.
        """
        untrained = self._work.count(0.0)
        unplanned = max(0, self._n_expected - self._n_planned - untrained)
        mean = self._planned / self._n_planned if self._n_planned else 1.0
        missing = max(0.0, self._planned - sum(self._work)) + unplanned * mean
        return seconds_left(self._ended_s, self._work, missing, self._n_workers, now_s)

    def _ended(self, work: float) -> str:
        """Count a run, and return the time left in words; '' without an estimate."""
        now_s = time.monotonic()
        self.end(now_s, work)
        left_s = self.seconds(now_s)
        return "" if left_s is None else f"about {duration(left_s)} left"


class Lines(TimeLeft):
    """One line per run, for logs."""

    def __init__(self, n_workers: int = 1) -> None:
        super().__init__(n_workers)
        self._last_doing_s = time.monotonic()

    def advance(self, text: str, work: float = 0.0) -> None:
        estimate = self._ended(work)
        self.note(f"{self.n_ended}/{self.n_expected} {text}{', ' if estimate else ''}{estimate}")

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


class _Bar(TimeLeft):
    """A bar on a terminal."""

    def __init__(self, n_workers: int, rich: rich.progress.Progress) -> None:
        super().__init__(n_workers)
        self._rich, self._task = rich, rich.add_task("preparing", total=0, left="")

    def expect(self, n_runs: int) -> None:
        super().expect(n_runs)
        self._rich.update(self._task, total=self.n_expected)

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
        yield Lines(n_workers) if enabled else Progress()
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


def seconds_left(
    ended_s: Sequence[float], work: Sequence[float], missing: float, n_workers: int, now_s: float
) -> float | None:
    """Return the estimated time until the missing work is done, or None while there is no estimate.

    The first run of each worker is not measured, since it includes preparing the data and compiling; there is
    an estimate once runs have ended at `_LEAST` later moments, of which those of a cohort are one. Moments
    rise, on the clock of `now_s`; work is in any unit.
    """
    ended, done = np.asarray(ended_s, np.float64), np.cumsum(work)
    last = np.flatnonzero(np.diff(ended, append=np.inf) > _APART_S)  # runs that end together
    if missing <= 0 or len(last) < n_workers + _LEAST:
        return None
    first = last[n_workers - 1]
    measured = float(done[-1] - done[first])
    if measured <= 0:
        return None
    left_s = (ended[-1] - ended[first]) / measured * missing - (now_s - ended[-1])
    return float(left_s) if left_s > 0 else None  # a job takes longer than any so far
