"""`dse skyline`: the Pareto front of a study, under constraints."""

from __future__ import annotations

import argparse
from pathlib import Path

from dse.cli import priced
from dse.cli.answer import FORMATS, Answer, add_format
from dse.cli.fronts import Objective, columns, records
from dse.cli.numbers import draws
from dse.study import priced as study_priced

HELP = "print the non-dominated design points of a study or of any table of points"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        "results",
        nargs="+",
        metavar="RESULTS",
        help="folder of a study, or a CSV, Parquet or JSON file; repeatable",
    )
    parser.add_argument(
        "--objectives",
        metavar="LIST",
        help="such as accuracy:max,energy_uj:min (default: those of the study)",
    )
    parser.add_argument(
        "--where", metavar="EXPR", help='condition, such as "n_weights <= 100000 and phi > 2"'
    )
    parser.add_argument(
        "--by",
        metavar="COLUMN",
        help="one front for each value of this column, such as task; several with commas. Costs on different "
        "hardware never share a front",
    )
    priced.add_hardware(parser)
    priced.add_duty(parser)
    parser.add_argument(
        "--draws",
        type=draws,
        metavar="N",
        help="draw the figures of the hardware so often: column front_share is the share of draws in which a "
        "point stays non-dominated",
    )
    add_format(parser, FORMATS)


def answer(arguments: argparse.Namespace) -> Answer:
    """Return the front of all the tables together."""
    import pandas

    from dse.skyline import front

    frames = study_priced.points(arguments.results, arguments.hardware)
    objectives = objectives_of(arguments.objectives, arguments.results[0])
    frame = study_priced.on_duty(
        pandas.concat(frames, ignore_index=True), arguments.contacts_per_hour, arguments.battery_mwh
    )
    by = [name.strip() for name in (arguments.by or "").split(",") if name.strip()]
    found = front.skyline(frame, objectives, arguments.where, by)
    rows, shown = found.rows, columns(found.rows, objectives)
    shown += [name for name in ("power_mw", "battery_h") if name in rows and name not in shown]
    if arguments.draws:
        names = [name for name, _ in objectives]
        drawing = study_priced.draws(arguments.results, frames, arguments.hardware, names, arguments.draws)
        among = front.comparable(frame, objectives, arguments.where, by).rows
        share = front.front_share(among, objectives, drawing, by)
        rows = rows.assign(front_share=pandas.Series(share, among.index)[rows.index])
        shown = [*shown, "front_share"]
    return Answer(records(rows), found.notes, shown)


def objectives_of(text: str | None, results: str) -> list[Objective]:
    """Return the objectives as given, else those of the study in a folder.

    Raises:
        ExpressionError: they cannot be read, or a plain table has none.
    """
    from dse.skyline.constraints import ExpressionError
    from dse.skyline.front import parse_objectives
    from dse.study.results import open as open_study

    if text is not None:
        return parse_objectives(text)
    if not Path(results).is_dir():
        raise ExpressionError(
            f"{results}: a table has no objectives; name them: --objectives accuracy:max,..."
        )
    return open_study(results).objectives
