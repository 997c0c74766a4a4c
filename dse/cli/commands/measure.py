"""`dse measure`: time and energy of an exported classifier on this machine."""

from __future__ import annotations

import argparse

from dse.cli.answer import Answer, add_format
from dse.cli.numbers import amount

GROUP = "deploy"
HELP = "measure time and energy of an exported classifier on this machine: as a stream and as C"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("bundle", metavar="BUNDLE", help="folder written by `dse pick --export`")
    parser.add_argument(
        "--data",
        metavar="RECORDINGS",
        help="recordings in the format of the training data (default: random input spikes, 2 %% of channels "
        "and steps)",
    )
    parser.add_argument(
        "--rest", type=amount, default=5.0, metavar="S", help="time at rest in seconds (default: 5)"
    )
    add_format(parser, ("table", "json", "csv", "parquet"))


def answer(arguments: argparse.Namespace) -> Answer:
    """Return one row per engine."""
    from dse.deploy.bundle import read
    from dse.deploy.measure import measure

    times = measure(read(arguments.bundle), arguments.data, max(arguments.rest, 0.1))
    notes = [f"{each.engine}: {_not_measured(each.reason)}" for each in times if each.reason]
    return Answer([each.columns for each in times], notes)


def _not_measured(reason: str) -> str:
    return f"energy_uj is empty: {reason}" if "counter" in reason else reason
