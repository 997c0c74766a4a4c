"""`dse compare`: two studies side by side."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from dse.cli.answer import FORMATS, Answer, add_format
from dse.cli.fronts import TELLING, columns, records
from dse.cli.options import add_hardware

if TYPE_CHECKING:
    from dse.skyline.goals import Goal

GROUP = "choose"
HELP = "compare two studies: the joint front, the hypervolume of each, and gains within budgets"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    for name in ("first", "second"):
        parser.add_argument(
            name,
            metavar=name.upper(),
            help="folder of a study, or a CSV, Parquet or JSON table",
        )
    parser.add_argument(
        "--objectives",
        metavar="LIST",
        help="e.g. accuracy:max,energy_uj:min (default: those of the studies, which must be the same)",
    )
    parser.add_argument(
        "--where",
        action="append",
        default=[],
        metavar="EXPR",
        help='keep the points of both that meet this condition, e.g. "n_weights <= 100000"; repeatable',
    )
    add_hardware(parser)
    parser.add_argument(
        "--html", type=Path, metavar="FILE", help="write the page of both, as one file that opens offline"
    )
    add_format(parser, FORMATS)


def answer(arguments: argparse.Namespace) -> Answer:
    """Return a row per study, task and hardware, with the joint front and the gains as sections."""
    from dse.skyline.compare import STUDY
    from dse.skyline.goals import parse_goals
    from dse.study.comparison import compare_studies

    given: list[Goal] | None = parse_goals(arguments.objectives) if arguments.objectives else None
    compared, tables, goals = compare_studies(
        arguments.first, arguments.second, given, arguments.where or None, arguments.hardware
    )
    notes = list(compared.notes)
    if arguments.html:
        from dse.dashboard.study import write_comparison

        notes.append(f"page: {write_comparison(compared, tables, goals, arguments.html)}")
    front = compared.front
    shown = [STUDY, *columns(front, goals)]
    essential = [name for name in (STUDY, "trial", *(name for name, _ in goals)) if name in front]
    return Answer(
        records(compared.summary),
        notes,
        essential=[STUDY, "on_joint_front", "hypervolume"],
        telling=TELLING,
        sections={
            "Joint front": Answer(records(front), columns=shown, essential=essential, telling=TELLING),
            "Best within a budget": Answer(records(compared.gains), all_rows=True),
        },
    )
