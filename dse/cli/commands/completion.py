"""`dse completion`: a shell's completion of commands, options and names."""

from __future__ import annotations

import argparse

from dse.cli.answer import Answer
from dse.cli.commands import commands_by_name
from dse.cli.completion import SHELLS, script

GROUP = "look up"
HELP = (
    "print a completion script for a shell, e.g. source <(dse completion bash); dse completion fish | source"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("shell", choices=SHELLS, help="bash, zsh or fish")


def answer(arguments: argparse.Namespace) -> Answer:
    """Return the script."""
    parsers = {}
    for name, module in commands_by_name().items():
        parsers[name] = argparse.ArgumentParser(description=module.HELP)
        module.add_arguments(parsers[name])
    return Answer([], text=script(arguments.shell, parsers))
