"""`dse evaluate`: run an exported classifier on new recordings."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from dse.cli.answer import Answer, add_format
from dse.cli.spaces import REPAIR

if TYPE_CHECKING:
    from dse.deploy.evaluate import Evaluation

HELP = "run an exported classifier on new recordings"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("bundle", metavar="BUNDLE", help="folder that `dse pick --export` wrote")
    parser.add_argument(
        "--data",
        required=True,
        metavar="FILE",
        help="recordings in the format of the training data; after "
        "training on a scene also event files, one or a folder of them",
    )
    parser.add_argument(
        "--each", action="store_true", help="one row per recording: its answer and when, not the summary"
    )
    parser.add_argument("--repair", action="store_true", help=REPAIR)
    add_format(parser, ("table", "json", "csv", "parquet"))


def answer(arguments: argparse.Namespace) -> Answer:
    """Return what the classifier does on the recordings."""
    from dse.deploy import evaluate

    found = evaluate.evaluate(arguments.bundle, arguments.data, repair=arguments.repair)
    rows = found.answers if arguments.each else [found.columns]
    return Answer(rows, [*_by_class(found), *(f"warning: {note}" for note in found.notes)])


def _by_class(found: Evaluation) -> list[str]:
    """Return one sentence per class that has labelled recordings, worst first."""
    if found.confusion is None:
        return []
    told = []
    for true, row in enumerate(found.confusion):
        if total := int(row.sum()):
            wrong = [(int(n), found.classes[k]) for k, n in enumerate(row) if k != true and n]
            taken = ", ".join(f"{n} taken for {name}" for n, name in sorted(wrong, key=lambda x: -x[0]))
            text = f"{found.classes[true]}: {int(row[true])} of {total} right" + (
                f"; {taken}" if taken else ""
            )
            told.append((row[true] / total, text))
    return [text for _, text in sorted(told, key=lambda x: x[0])]
