"""`dse prepare`: public recordings as the shipped search spaces read them."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from dse.cli.answer import Answer, add_format

GROUP = "begin"
HELP = "convert public recordings, as their authors publish them, to what the shipped search spaces read"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("set", nargs="?", metavar="SET", help="name of a set (without one: list all)")
    parser.add_argument(
        "source", nargs="?", type=Path, metavar="SOURCE", help="folder with the authors' files"
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="folder of recordings, where search spaces look files up (default: $DSE_DATA)",
    )
    add_format(parser)


def answer(arguments: argparse.Namespace) -> Answer:
    """Convert the set, or list the sets with their origins."""
    from dse.recordings import RecordingError
    from dse.recordings.prepare import prepare, sets

    if arguments.set is None:
        rows = [
            {
                "set": name,
                "file": one.file,
                "origin": one.origin,
                "licence": one.licence or "none stated",
                "converted from": ", ".join(one.files),
            }
            for name, one in sets().items()
        ]
        return Answer(rows, all_rows=True)
    if arguments.source is None:
        raise RecordingError(f"prepare {arguments.set} needs SOURCE, the folder with the authors' files")
    out = arguments.out or os.environ.get("DSE_DATA")
    if not out:
        raise RecordingError("prepare needs --out DIR, or DSE_DATA, the folder of recordings")
    written = prepare(arguments.set, arguments.source, Path(out))
    answers = {True: "yes", False: "no, other recordings", None: "in no search space"}
    rows = [{"file": str(one.path), "as in the published results": answers[one.published]} for one in written]
    return Answer(rows)
