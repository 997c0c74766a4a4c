"""A fault of a user's file, and the error that carries all of them at once."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from dse.base.text import one_line


@dataclass(frozen=True)
class Fault:
    """One mistake: where it is and what must be different.

    path: the file, or `--set key` for a value given on the command line.
    line: line in the file counted from 1; 0 where no line belongs to the fault.
    """

    path: str
    line: int
    message: str

    def __str__(self) -> str:
        """Return `file:line: message`."""
        place = f"{self.path}:{self.line}" if self.line else self.path
        return one_line(f"{place}: {self.message}")


class ConfigError(Exception):
    """Everything that is wrong with a user's input; its text has one line per fault."""

    def __init__(self, faults: Sequence[Fault]) -> None:
        """Keep the faults in the order of the file."""
        self.faults = list(faults)
        super().__init__("\n".join(map(str, self.faults)))

    def __reduce__(self) -> tuple[type[ConfigError], tuple[list[Fault]]]:
        """Pickle the faults, not their text: errors cross process borders."""
        return ConfigError, (self.faults,)


def known_names(name: str, known: Iterable[str]) -> str:
    """Return `known: a, b. Did you mean 'a'?`, the end of a sentence about an unknown name."""
    names = list(known)
    near = did_you_mean(name, names)
    return f"known: {', '.join(names) or 'none'}{'. ' if near else ''}{near}"


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return `Did you mean 'a'?`, '' if no known name is like an unknown one."""
    near = difflib.get_close_matches(name, list(known), n=1, cutoff=0.6)
    return f"Did you mean '{near[0]}'?" if near else ""
