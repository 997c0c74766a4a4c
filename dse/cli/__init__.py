"""The command line: `dse COMMAND`.

A command is one module of `commands/`, and the module's name is the command's. It defines `GROUP` (one of
`command_line.GROUPS`), `HELP`, `add_arguments(parser)` and `answer(arguments) -> Answer`. Results go to
stdout, progress and errors to stderr. Exit codes: 0 success, 1 nothing could be trained, 2 bad input,
3 no design point meets the budgets, 130 stopped by Ctrl-C.
"""

from dse.cli.command_line import main

__all__ = ["main"]
