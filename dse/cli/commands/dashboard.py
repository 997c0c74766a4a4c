"""`dse dashboard`: the page of a study."""

from __future__ import annotations

import argparse
from pathlib import Path

from dse.cli.answer import Answer
from dse.cli.pages import write_page

HELP = "write the page of a study: one HTML file that opens without a server"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("results", metavar="RESULTS", help="folder of a study")
    parser.add_argument(
        "--html", type=Path, metavar="FILE", help="where to write it (default: RESULTS/page.html)"
    )


def answer(arguments: argparse.Namespace) -> Answer:
    """Write the page and return where it is."""
    from dse import study

    path = write_page(study.open(arguments.results), arguments.html)
    return Answer([{"page": str(path)}], text=str(path))
