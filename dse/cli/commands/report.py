"""`dse report`: the published systems, their figures beside ours."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from dse.cli.answer import FORMATS, Answer, add_format, with_interval
from dse.cli.audits import audit_answer

if TYPE_CHECKING:
    from dse.study.results import Study

GROUP = "choose"
HELP = "compare studies with published systems, spiking with other families, and chips with each other"
_HONEST = ("shifted", "shifted_se", "unseen", "unseen_se")  # where a study evaluates them
_SHOWN = (
    *("system", "figure", "task", "published", "corrected", "ours", "se", "low", "high", "test"),
    *("reader", "reader_se", *_HONEST),
    *("runs", "hardware", "family", "trial", "study"),
)
_ESSENTIAL = ("system", "figure", "published", "corrected", "ours")
_TELLING = ("task",)
_PAPER = (
    *(
        "kind",
        "where",
        "quantity",
        "condition",
        "printed",
        "ours",
        "se",
        "low",
        "high",
        "runs",
        "same",
        "why",
    ),
    *("causes", "setup", "study"),
)
_NOTHING = 1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        "results", nargs="+", metavar="RESULTS", help="folders of studies, or a folder that contains some"
    )
    parser.add_argument(
        "--system",
        metavar="LETTERS",
        help="print only the rows of these published systems, by their letters in the report, e.g. A or DE",
    )
    parser.add_argument(
        "--paper",
        metavar="PAPER",
        help="print every number of one paper beside ours: 000 to 004, or a name such as texture_velocity; "
        "the studies must be of the paper's set-up",
    )
    parser.add_argument(
        "--hardware",
        action="append",
        metavar="NAME",
        help="compare this hardware profile (name or YAML file) with others; repeatable (default: the "
        "profiles of each study)",
    )
    add_format(parser, FORMATS)


def answer(arguments: argparse.Namespace) -> Answer:
    """Return the rows of every named study, and of every study in a named folder."""
    from dse.measure.on_chips import DRAWN
    from dse.report import report
    from dse.report.papers import systems

    studies = {study.folder.resolve(): study for text in arguments.results for study in _studies(Path(text))}
    if arguments.paper is not None:
        return _of_paper(list(studies.values()), arguments)
    known = systems()
    letters = _systems(arguments.system, list(known))
    chips = _chips(arguments.hardware)
    gathered = report(list(studies.values()), chips)
    rows = [row for row in gathered.rows if letters is None or row.system in letters]
    used = {row.system for row in rows}
    titles = [f"{name}: {known[name].title} ({known[name].source})" for name in known if name in used]
    splits = dict.fromkeys((row.study, row.task, row.split) for row in rows if row.split)
    splits_of_rows = [f"{study}, {task}: {split}" for study, task, split in splits]
    code = 0 if rows else _NOTHING
    columns = [row.columns for row in rows]
    empty = {name for name in (*_HONEST, "reader", "reader_se") if all(row[name] is None for row in columns)}
    columns = [{name: x for name, x in row.items() if name not in empty} for row in columns]
    values = {name: {row.get(name) for row in columns} - {None, ""} for name in _SHOWN}
    # A terminal shows no empty columns, and no column for the name of the only study.
    shown = [name for name in _SHOWN if len(values[name]) > (name == "study")]
    audits = {f"audit of {name}": audit_answer(audit) for name, audit in gathered.audits.items()}
    notes = [*titles, *splits_of_rows, *gathered.notes]
    essential = [name for name in _ESSENTIAL if name in shown]
    table = [
        with_interval(row, "ours", row["low"], row["high"]) if str(row["figure"]).endswith(DRAWN) else row
        for row in columns  # the ends of a ratio stand beside it, whatever they are
    ]
    return Answer(
        *(columns, notes, shown, essential, _TELLING),
        table=table,
        code=code,
        all_rows=True,
        sections=audits,
    )


def _of_paper(studies: list[Study], arguments: argparse.Namespace) -> Answer:
    """Return every number of a paper beside ours.

    Raises:
        ExpressionError: there is no such paper, or a system or profiles are named too.
        SetupError: no study is of its set-up.
    """
    from dse.report import key_of, paper_report
    from dse.report.papers import publications
    from dse.skyline.constraints import ExpressionError

    name = arguments.paper
    if arguments.system is not None or arguments.hardware is not None:
        raise ExpressionError("--paper must be without --system and --hardware, got more than one of them")
    key = key_of(name)
    if key is None:
        papers = ", ".join(f"{number} ({paper.name})" for number, paper in publications().items())
        raise ExpressionError(f"--paper must be one of {papers}, got '{name}'")
    compared = paper_report(studies, key)
    columns = [row.columns for row in compared.rows]
    used = {name: {row[name] for row in columns} - {None, ""} for name in _PAPER}
    shown = [name for name in _PAPER if len(used[name]) > (name == "study")]
    return Answer(columns, compared.notes, shown, all_rows=True)


def _systems(text: str | None, known: list[str]) -> set[str] | None:
    """Return the systems of --system; None: all, and our families against each other.

    Raises:
        ExpressionError: one is unknown, or none is named.
    """
    from dse.skyline.constraints import ExpressionError

    if text is None:
        return None
    letters = dict.fromkeys(text.upper().replace(",", "").replace(" ", ""))
    unknown = [name for name in letters if name not in known]
    if unknown or not letters:
        raise ExpressionError(f"--system must be letters among {', '.join(known)}, e.g. DE, got '{text}'")
    return set(letters)


def _chips(names: list[str] | None) -> list[str]:
    """Return the profiles to compare; an empty list without --hardware.

    Raises:
        ExpressionError: there is only one.
    """
    from dse.skyline.constraints import ExpressionError

    chips = list(dict.fromkeys(names or []))
    if len(chips) == 1:
        raise ExpressionError(f"--hardware must name two profiles or more, got only '{chips[0]}'")
    return chips


def _studies(path: Path) -> list[Study]:
    from dse.store import StoreError
    from dse.study import results

    if (path / "search_space.yaml").is_file():
        return [results.open(path)]
    inside = sorted(x.parent for x in path.glob("*/points.parquet")) if path.is_dir() else []
    if not inside:
        raise StoreError(f"{path}: must be the folder of a study with results, or contain such folders")
    return [results.open(folder) for folder in inside]
