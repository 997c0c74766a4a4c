"""`dse audit`: what could pass for skill in the recordings and the split of a search space."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from dse.cli.answer import FORMATS, Answer, add_format
from dse.cli.options import add_space, load

GROUP = "search"
HELP = "find what could pass for skill in recordings and split: position, twins, sessions and others"
_SHOWN = (
    *("task", "probe", "reader", "accuracy", "se", "chance", "without"),
    *("shortcut", "verdict", "remedy"),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_space(parser)
    parser.add_argument(
        "--shifts",
        type=int,
        nargs="+",
        default=[],
        metavar="STEPS",
        help="move windows by these steps (default: an eighth of their length, both ways); one row per shift",
    )
    add_format(parser, FORMATS)


def answer(arguments: argparse.Namespace) -> Answer:
    """Audit a search space, store the audit, and return its rows."""
    space = load(arguments)
    from dse.audit import audit, record
    from dse.dataset import cache

    with tempfile.TemporaryDirectory() as folder:
        root, note = cache.opened_root(Path(folder))
        result = audit(space, root, arguments.shifts)
        if not note:
            record.save(result, space, root)
    rows = [row.columns for row in result.rows]
    shown = [name for name in _SHOWN if name != "task" or len({row.task for row in result.rows}) > 1]
    return Answer(rows, [*result.notes, *filter(None, [note])], shown, all_rows=True)
