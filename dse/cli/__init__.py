"""The command line: `dse COMMAND`.

A command is one file of `commands/` with `HELP`, `add_arguments(parser)` and `answer(arguments) -> Answer`,
named in `command_line.COMMANDS`. Results go to stdout, progress and mistakes to stderr. Exit codes: 0 done,
1 nothing could be trained, 2 bad input, 3 nothing within the budgets, 130 stopped by Ctrl-C.
"""

from dse.cli.command_line import main

__all__ = ["main"]
