"""`dse run`: train the designs of a search space; the same command goes on where it was stopped."""

from __future__ import annotations

import argparse
import dataclasses
from typing import TYPE_CHECKING

from dse.cli.answer import Answer, add_format
from dse.cli.fronts import front
from dse.cli.numbers import positive
from dse.cli.spaces import add_space, load
from dse.dashboard.study import write_page

if TYPE_CHECKING:
    from dse.study.results import Study

HELP = "train the designs of a search space; run it again to go on where it was stopped"
_NOTHING_TRAINED = 1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_space(parser)
    parser.add_argument(
        "--results", default="results", metavar="DIR", help="folder of studies (default: results)"
    )
    parser.add_argument(
        "--jobs", type=positive, metavar="N", help="processes at a time (default: as the file says)"
    )
    parser.add_argument("--quiet", action="store_true", help="no progress on stderr")
    add_format(parser)


def answer(arguments: argparse.Namespace) -> Answer:
    """Train what is missing, write the page, and return the front."""
    space = load(arguments)
    from dse.study import explore

    done = explore.run(space, arguments.results, jobs=arguments.jobs, progress=not arguments.quiet)
    notes = [*done.warnings, _page(done)]
    failed = done.trials[done.trials["status"] == "failed"]
    if len(failed):
        notes.append(
            f"{len(failed)} of {len(done.trials)} designs failed; the first: {failed['reason'].iloc[0]}"
        )
    points = done.points()
    if points.empty:
        return Answer([], notes, code=_NOTHING_TRAINED)
    if "hardware" in points and points["hardware"].nunique() > 1:  # costs on different chips do not compare
        first = points["hardware"].iloc[0]
        points = points[points["hardware"] == first]
        notes.append(f"costs are those on {first}; dse skyline --where \"hardware == '...'\" shows another's")
    several = points["task"].nunique() > 1  # accuracies of different tasks do not compare
    result = front(points, done.objectives, by="task" if several else None)
    return dataclasses.replace(result, notes=[*result.notes, *notes])


def _page(done: Study) -> str:
    """Write the page of a study and return a note about it: without one, the study is as finished."""
    try:
        return f"page: {write_page(done)}"
    except Exception as error:  # tables and figures of whatever a study holds may fail in any way
        why = str(error) or type(error).__name__
        return f"the page could not be written: {why}; dse dashboard {done.folder} --html FILE tries again"
