"""`dse export`: write a bundle's classifier for targets, run them, and state what differs."""

from __future__ import annotations

import argparse

from dse.cli.answer import Answer, add_format
from dse.cli.options import add_targets

GROUP = "deploy"
HELP = "write the classifier of a bundle for targets (C, microcontrollers, NIR, ...) and verify them by a run"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("bundle", metavar="BUNDLE", help="folder written by `dse pick --export`")
    add_targets(parser, required=True)
    parser.add_argument(
        "--prefix",
        metavar="NAME_",
        help="of the names and files in C, so that several classifiers live in one program: texture_ gives "
        "texture_init and texture.h (default: that of the bundle, dse_ at first)",
    )
    add_format(parser)


def answer(arguments: argparse.Namespace) -> Answer:
    """Return the verdict on every target; the bundle holds their files and verdicts then."""
    from dse.cli import verdicts
    from dse.deploy.verify import export_targets

    verified = export_targets(arguments.bundle, arguments.target, arguments.verify, arguments.prefix)
    drifts = verdicts.drifts(verified)
    return Answer(verdicts.rows(verified), drifts, code=verdicts.DRIFT if drifts else 0)
