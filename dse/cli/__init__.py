"""The command line: `dse COMMAND`.

A command is one function of a module of `commands/`, which lists it: its signature and docstring are the
arguments and the help (`dse.cli.signature`), and it returns an `Answer`.
Results go to stdout, progress and errors to stderr. Exit codes: 0 success, 1 nothing could be trained,
2 bad input, 3 no design point meets the budgets, 130 stopped by Ctrl-C.
"""

from __future__ import annotations

from collections.abc import Sequence

from dse.cli.stopping import INTERRUPTED


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code; print users' mistakes on stderr, one line each."""
    try:
        from dse.cli import command_line  # takes half a second, in which Ctrl-C may come
    except KeyboardInterrupt:
        return INTERRUPTED
    return command_line.main(arguments)
