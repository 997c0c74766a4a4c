"""`dse merge`: two studies of one search space as one."""

from __future__ import annotations

import argparse
from pathlib import Path

from dse.cli.answer import Answer, add_format

GROUP = "search"
HELP = "join two studies of one search space: equal designs once, with the repeats of both"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("first", metavar="A", help="folder of a study")
    parser.add_argument("second", metavar="B", help="folder of another study")
    parser.add_argument(
        "--into", required=True, metavar="C", help="folder of the new study; its name is the study's"
    )
    add_format(parser)


def answer(arguments: argparse.Namespace) -> Answer:
    """Write the joint study and return how many designs and runs it has."""
    from dse.study.merge import merge

    into = Path(arguments.into)
    counts = merge(Path(arguments.first), Path(arguments.second), into)
    return Answer([{"study": str(into), **counts}])
