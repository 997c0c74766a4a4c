"""`dse evaluate`: run an exported classifier on new recordings."""

from __future__ import annotations

import argparse

from dse.cli.answer import Answer, add_format

HELP = "run an exported classifier on new recordings"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("bundle", metavar="BUNDLE", help="folder that `dse pick --export` wrote")
    parser.add_argument(
        "--data", required=True, metavar="FILE", help="recordings in the format of the training data"
    )
    add_format(parser)


def answer(arguments: argparse.Namespace) -> Answer:
    """Return what the classifier does on the recordings."""
    from dse import bundles

    return Answer([bundles.evaluate(arguments.bundle, arguments.data).columns])
