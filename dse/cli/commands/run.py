"""`dse run`: train the designs of a search space; the same command resumes a stopped study."""

from __future__ import annotations

import dataclasses
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dse.cli.answer import FORMATS, Answer
from dse.cli.fields import flag, formats, option
from dse.cli.fronts import front
from dse.cli.options import InResults, load
from dse.cli.stopping import by_signals

if TYPE_CHECKING:
    from dse.study.results import Study

GROUP = "search"
HELP = "train the designs of a search space; the same command resumes a stopped study"
_NOTHING_TRAINED = 1
_NOT_ALL_TRAINED = 1


@dataclass(frozen=True, kw_only=True)
class Arguments(InResults):
    """The arguments."""

    jobs: int | None = option(
        "N", "number of worker processes (default: execution.jobs of the search space)", low=1
    )
    quiet: bool = flag("print no progress on stderr")
    format: str | None = formats(FORMATS)


def answer(arguments: Arguments) -> Answer:
    """Train the designs that are not trained yet, write the page, and return the front."""
    space = load(arguments)
    from dse.study import explore
    from dse.study.health import faults
    from dse.study.racing import sentences
    from dse.study.runs import UNTRAINED
    from dse.study.tables import n_held

    try:
        with by_signals():
            study = explore.run(space, arguments.results, jobs=arguments.jobs, progress=not arguments.quiet)
    except KeyboardInterrupt:
        print(n_held(space, Path(arguments.results) / space.study), file=sys.stderr)
        raise
    notes = [*study.warnings, n_held(space, Path(arguments.results) / space.study), _page(study)]
    failed = study.trials[study.trials["status"] == "failed"]
    trained = study.trials[study.trials["status"] != "excluded"]
    if len(excluded := study.trials[study.trials["status"] == "excluded"]):
        n = f"{len(excluded)} design{'s' if len(excluded) > 1 else ''}"
        notes.append(f"{n} excluded before training; the first: {excluded['reason'].iloc[0]}")
    if len(failed):
        notes.append(f"{len(failed)} of {len(trained)} designs failed; the first: {failed['reason'].iloc[0]}")
    notes += [*sentences(study.folder), *faults(study.trials)]
    points = study.points()
    if points.empty:
        return Answer([], notes, code=_NOTHING_TRAINED)
    # Costs on different chips cannot be compared.
    if "hardware" in points and points["hardware"].nunique() > 1:
        first = points["hardware"].iloc[0]
        points = points[points["hardware"] == first]
        notes.append(
            f"costs are those on {first}; for another chip use dse skyline --where \"hardware == '...'\""
        )
    result = front(points, study.objectives)
    code = _NOT_ALL_TRAINED if any(note.startswith(UNTRAINED) for note in notes) else result.code
    return dataclasses.replace(result, notes=[*result.notes, *notes], code=code)


def _page(study: Study) -> str:
    """Write the page of a study and return a note about it; an error leaves the study finished."""
    try:
        from dse.dashboard.study import write_page

        return f"page: {write_page(study)}"
    except Exception as error:  # a page gathers every table and figure; no error of theirs may fail the run
        why = str(error) or type(error).__name__
        return (
            f"the page could not be written: {why}; try again with dse dashboard {study.folder} --html FILE"
        )
