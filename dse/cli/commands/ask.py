"""`dse ask`: the designs that the sampler proposes next, for measurements elsewhere."""

from __future__ import annotations

import argparse

from dse.cli.answer import Answer, add_format
from dse.cli.numbers import positive
from dse.cli.options import add_space, load

GROUP = "search"
HELP = "print the design that the sampler proposes next, with its number, to be measured elsewhere"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_space(parser)
    parser.add_argument("--n", type=positive, default=1, help="number of designs (default: 1)")
    parser.add_argument(
        "--results", default="results", metavar="DIR", help="folder for studies (default: results)"
    )
    add_format(parser)


def answer(arguments: argparse.Namespace) -> Answer:
    """Propose designs, write them to the study, and return them as YAML."""
    space = load(arguments)
    import yaml

    from dse.store import plain
    from dse.study.outside import ask

    asked, notes = ask(space, arguments.results, arguments.n)
    rows = [{"trial": trial, "design": plain(design)} for trial, design in asked]
    text = yaml.safe_dump(rows, sort_keys=False).rstrip() if rows else ""
    return Answer(rows, notes, text=text, code=0 if rows else 1)
