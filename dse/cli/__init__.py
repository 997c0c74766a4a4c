"""The command line: `dse COMMAND`.

A command is one module of `commands/`, and the module's name is the command's. It defines `GROUP` (one of
`command_line.GROUPS`), `HELP`, `Arguments` (its fields: `dse.cli.fields`) and `answer(arguments) -> Answer`.
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
