"""`dse tell`: record values of a design that were measured elsewhere."""

from __future__ import annotations

import argparse
from pathlib import Path

from dse.cli.answer import Answer, add_format
from dse.config import ConfigError, Fault

GROUP = "search"
HELP = "record the values of a design of dse ask; the tables mark them as told"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("results", metavar="RESULTS", help="folder of a study")
    parser.add_argument("trial", metavar="DESIGN", type=int, help="number that dse ask gave the design")
    parser.add_argument(
        "values",
        metavar="COLUMN=VALUE",
        nargs="*",
        help="its values, such as accuracy=0.91 energy_uj=12.5; every objective of the study is needed",
    )
    parser.add_argument("--failed", default="", metavar="REASON", help="the design has no values, and why")
    add_format(parser)


def answer(arguments: argparse.Namespace) -> Answer:
    """Record the values and return the row of the design."""
    told, faults = {}, []
    for text in arguments.values:
        name, _, value = text.partition("=")
        try:
            told[name] = float(value)
        except ValueError:
            faults.append(Fault(f"'{text}'", 0, "must be COLUMN=VALUE with a number, such as accuracy=0.91"))
    if bool(arguments.values) == bool(arguments.failed):
        faults.append(Fault("dse tell", 0, "needs values, such as accuracy=0.91, or --failed REASON"))
    if faults:
        raise ConfigError(faults)
    from dse.study.outside import tell

    row = tell(Path(arguments.results), arguments.trial, told, arguments.failed)
    return Answer([row])
