"""What a study tells whoever waits for it, on stderr: a bar with the time left, or one line per run."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

# Between two lines of a log about what goes on, at least.
_DOING_S = 10.0


class Progress(Protocol):
    """How a study reports; `expect` may raise the number of runs as it goes."""

    def expect(self, n_runs: int) -> None:
        """Announce that many more training runs."""

    def advance(self, text: str) -> None:
        """One run has ended; `text` says which and how."""

    def doing(self, text: str) -> None:
        """Say what goes on before the next run ends: what comes later replaces it."""

    def note(self, text: str) -> None:
        """Say something that matters: a warning, a stage."""


@contextmanager
def shown(wanted: bool) -> Iterator[Progress]:
    """Yield what shows progress: a bar on a terminal, lines elsewhere, nothing where not wanted."""
    if not wanted:
        yield Silent()
    elif sys.stderr.isatty():
        with _bar() as bar:
            yield bar
    else:
        yield Lines()


class Silent:
    """Says nothing."""

    def expect(self, n_runs: int) -> None:
        """Say nothing."""

    def advance(self, text: str) -> None:
        """Say nothing."""

    def doing(self, text: str) -> None:
        """Say nothing."""

    def note(self, text: str) -> None:
        """Say nothing."""


class Lines:
    """One line per run, for logs."""

    def __init__(self) -> None:
        self._began = self._said = time.monotonic()
        self._done = 0
        self._expected = 0

    def expect(self, n_runs: int) -> None:
        """Raise the number of runs expected."""
        self._expected += n_runs

    def advance(self, text: str) -> None:
        """Print the run and an estimate of the time left."""
        self._done += 1
        left = (time.monotonic() - self._began) / self._done * max(0, self._expected - self._done)
        self.note(f"{self._done}/{self._expected} {text}, about {_duration(left)} left")

    def doing(self, text: str) -> None:
        """Print a line, now and then."""
        if time.monotonic() - self._said >= _DOING_S:
            self._said = time.monotonic()
            self.note(text)

    def note(self, text: str) -> None:
        """Print a line."""
        # In one piece: `print` writes the line's end apart, and Ctrl-C may fall between the two.
        sys.stderr.write(f"{text}\n")
        sys.stderr.flush()


@contextmanager
def _bar() -> Iterator[Progress]:
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Rich

    columns = (
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(compact=True),
        TextColumn("{task.description}"),
    )
    with Rich(*columns, console=Console(stderr=True)) as rich:
        task = rich.add_task("preparing", total=0)

        class Bar:
            def expect(self, n_runs: int) -> None:
                rich.update(task, total=(rich.tasks[0].total or 0) + n_runs)

            def advance(self, text: str) -> None:
                rich.update(task, advance=1, description=escape(text))

            def doing(self, text: str) -> None:
                rich.update(task, description=escape(text))

            def note(self, text: str) -> None:
                rich.console.print(text, markup=False, highlight=False)

        yield Bar()


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s" if minutes else f"{rest} s"
