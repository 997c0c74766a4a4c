"""`dse enqueue`: designs to train next, also while the study runs."""

from __future__ import annotations

import argparse
from pathlib import Path

from dse.cli.answer import Answer, add_format
from dse.cli.options import add_space, load

GROUP = "search"
HELP = "train designs of your choice next; a running study begins them after its batch"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_space(parser)
    parser.add_argument(
        "designs",
        metavar="FILE",
        help="a YAML file: a mapping of axes to values, such as model.hidden: 40, or a list of these",
    )
    parser.add_argument(
        "--results", default="results", metavar="DIR", help="folder for studies (default: results)"
    )
    add_format(parser)


def answer(arguments: argparse.Namespace) -> Answer:
    """Append the designs to the queue of the study, and return them."""
    space = load(arguments)
    from dse.study import queue

    designs = queue.read_designs(space, Path(arguments.designs))
    folder = Path(arguments.results) / space.study
    queue.add(folder, designs)
    n = f"{len(designs)} design{'s' if len(designs) > 1 else ''}"
    return Answer(designs, [f"{n} enqueued in {folder}; `dse run` trains them"])
