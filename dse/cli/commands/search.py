"""Commands about what is trained: a search space, its recordings, its study."""

from __future__ import annotations

import dataclasses
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from dse.cli.answer import Answer, audit_answer, listing
from dse.cli.signature import Amount, Count, Texts
from dse.cli.spaces import load, overrides_of
from dse.config import ConfigError, SearchSpace

if TYPE_CHECKING:
    from dse.study.results import Study

_BAD_INPUT = 2


def audit(space: str, *, set: Texts = (), repair: bool = False, shifts: tuple[int, ...] = ()) -> Answer:
    """Find what could pass for skill in recordings and split: position in time, twins, sessions and others.

    Args:
        shifts (STEPS): move windows by these steps, and print one row for each (default: an eighth of their
            length, both ways).
    """
    loaded = load(space, set, repair)
    from dse.data.dataset import cache
    from dse.study import audit as auditing
    from dse.study.audit import record
    from dse.study.progress import Lines

    with tempfile.TemporaryDirectory() as instead:
        root, note = cache.opened_root(Path(instead))
        result = auditing.audit(loaded, root, shifts, Lines().doing)
        if not note:
            record.save(result, loaded, root)
    table = audit_answer(result)
    return dataclasses.replace(table, notes=[*table.notes, *filter(None, [note])])


def check(space: str, *, set: Texts = (), repair: bool = False, format: str | None = None) -> Answer:
    """Check a search space without training: list every fault, or what a run would do.

    Raises:
        ConfigError: the faults; with `--json` they are the answer, and printed on stderr.
    """
    from dse.config.yaml_lines import in_file_order, read_document
    from dse.study.preview import is_large, preview, refusals

    try:
        loaded = load(space, set, repair)
        if not is_large(loaded):
            document = read_document(loaded.source, overrides_of(set))
            if faults := [document.fault(path, message) for path, message in refusals(loaded)]:
                raise in_file_order(faults)
        row = preview(loaded)
    except ConfigError as error:
        if format != "json":
            raise
        print(error, file=sys.stderr)
        return Answer([vars(fault) for fault in error.faults], code=_BAD_INPUT)
    doubts = row.pop("doubts", [])
    assert isinstance(doubts, list)  # as `preview` has it
    return Answer([row], doubts, text=listing([(name, _text(value)) for name, value in row.items()]))


def _text(value: object) -> str:
    if isinstance(value, list):
        return ", ".join(map(str, value)) or "none"
    if isinstance(value, dict):
        return ", ".join(f"{name} {_text(inner)}" for name, inner in value.items())
    return "unlimited" if value is None else str(value)


def doctor(results: str, *, repair: bool = False) -> Answer:
    """Say what is damaged or missing in a study's folder and what it costs; repair what can be repaired.

    Args:
        repair: move damaged runs and copies aside; write the book and the tables again; convert the folder of
            an earlier version. `dse run` trains what is missing then.

    Returns:
        A row per damage; exit code 1 while there is some that is not repaired.
    """
    from dse.study import doctor as examining

    folder = Path(results)
    damages = examining.examine(folder)
    if not damages:
        return Answer([], text=f"{folder}: nothing is damaged")
    if not repair:
        mended = any(x.repair is not None for x in damages)
        left, notes = list(damages), [f"`dse doctor {folder} --repair` repairs what it can"] if mended else []
    else:
        left, notes = examining.repair(folder)
        n_left = len({x.file for x in left} & {x.file for x in damages})
        notes += [f"{len(damages) - n_left} of {len(damages)} repaired"]
        notes += [f"not repaired: {x.file} {x.fault}; {x.remedy}" for x in left]
    rows = [{"file": x.file, "fault": x.fault, "cost": x.cost, "remedy": x.remedy} for x in damages]
    return Answer(rows, notes, all_rows=True, code=1 if left else 0)


def enqueue(
    space: str, designs: str, *, set: Texts = (), repair: bool = False, results: str = "results"
) -> Answer:
    """Train designs of your choice next; a running study begins them after its batch.

    Args:
        designs (FILE): a YAML file: a mapping of axes to values, such as model.hidden: 40, or a list of
            these.
        results (DIR): folder for studies (default: results).
    """
    loaded = load(space, set, repair)
    from dse.study import queue

    read = queue.read_designs(loaded, Path(designs))
    folder = Path(results) / loaded.study
    queue.enqueue(folder, read)
    n = f"{len(read)} design{'s' if len(read) > 1 else ''}"
    return Answer(read, [f"{n} enqueued in {folder}; `dse run` trains them"])


def run(
    space: str,
    *,
    set: Texts = (),
    repair: bool = False,
    results: str = "results",
    jobs: Count = None,
    minutes: Amount = None,
    quiet: bool = False,
) -> Answer:
    """Train the designs of a search space; the same command resumes a stopped study.

    Args:
        results (DIR): folder for studies (default: results).
        jobs: number of worker processes (default: execution.jobs of the search space).
        minutes: time that the command takes, as search.stop.minutes (default: as long as the search does).
        quiet: print no progress on stderr.

    Returns:
        The front, and whether to spike; the page is written too.
    """
    stop = () if minutes is None else (f"search.stop.minutes={minutes}",)
    loaded = load(space, (*set, *stop), repair)
    from dse.cli.fronts import front_answer, rivals_section
    from dse.cli.stopping import by_signals
    from dse.skyline.front import skyline
    from dse.study import explore
    from dse.study.rivals import of_study
    from dse.study.runs import UNTRAINED
    from dse.study.tables import n_held

    try:
        with by_signals():
            study = explore.run(loaded, results, jobs=jobs, progress=not quiet)
    except KeyboardInterrupt:
        print(n_held(loaded, Path(results) / loaded.study), file=sys.stderr)
        raise
    notes = _notes_of_run(study, loaded)
    points = study.points()
    if points.empty:
        return Answer([], notes, code=1)
    # Costs on different chips cannot be compared.
    if "hardware" in points and points["hardware"].nunique() > 1:
        first = points["hardware"].iloc[0]
        points = points[points["hardware"] == first]
        notes.append(
            f"costs are those on {first}; for another chip use dse skyline --where \"hardware == '...'\""
        )
    front = skyline(points, study.objectives)
    result = front_answer(front.rows, study.objectives, front.notes)
    code = 1 if any(note.startswith(UNTRAINED) for note in notes) else result.code
    sections = rivals_section(lambda: of_study(study))
    return dataclasses.replace(result, notes=[*result.notes, *notes], code=code, sections=sections)


def _notes_of_run(study: Study, space: SearchSpace) -> list[str]:
    from dse.study.health import failures, faults
    from dse.study.racing import saved
    from dse.study.tables import n_held

    notes = [*study.warnings, n_held(space, study.folder), _page(study)]
    trials = study.trials
    excluded = trials[trials["status"] == "excluded"]
    if len(excluded):
        n = f"{len(excluded)} design{'s' if len(excluded) > 1 else ''}"
        notes.append(f"{n} excluded before training; the first: {excluded['reason'].iloc[0]}")
    return [*notes, *failures(trials), *saved(study.folder), *faults(trials)]


def _page(study: Study) -> str:
    """Write the page of a study and return a note about it; an error leaves the study finished."""
    try:
        from dse.show.dashboard.study import write_page

        return f"page: {write_page(study, plays=False)}"
    except Exception as error:  # a page gathers every table and figure; no error of theirs may fail the run
        why = str(error) or type(error).__name__
        return (
            f"the page could not be written: {why}; try again with dse dashboard {study.folder} --html FILE"
        )
