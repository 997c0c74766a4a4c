"""`dse verify`: run the targets of a bundle again, on this machine and these recordings."""

from __future__ import annotations

import argparse

from dse.cli.answer import Answer, add_format

GROUP = "deploy"
HELP = "run the targets of a bundle on recordings and compare all decisions and spikes"
_UNVERIFIED = 2


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("bundle", metavar="BUNDLE", help="folder with targets that `dse export` wrote")
    parser.add_argument(
        "--data", required=True, metavar="RECORDINGS", help="recordings in the format of the training data"
    )
    parser.add_argument(
        "--target",
        action="append",
        metavar="NAME",
        help="target to run (default: all of the bundle); repeatable",
    )
    add_format(parser)


def answer(arguments: argparse.Namespace) -> Answer:
    """Return the verdict on every target, beside that of the bundle."""
    from dse.cli import verdicts
    from dse.deploy.verify import verify

    verified = verify(arguments.bundle, arguments.data, arguments.target)
    drifts = verdicts.drifts(verified)
    unverified = any(each.verdict.kind == "not verified" for each in verified.values())
    code = verdicts.DRIFT if drifts else _UNVERIFIED if unverified else 0
    return Answer(verdicts.rows(verified), drifts, code=code)
