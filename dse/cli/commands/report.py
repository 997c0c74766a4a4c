"""`dse report`: families, chips and published systems beside each other."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from dse import registry
from dse.cli.answer import FORMATS, Answer, add_format, with_interval
from dse.cli.audits import audit_answer

if TYPE_CHECKING:
    from dse.report import Published
    from dse.study.results import Study

GROUP = "choose"
HELP = "compare spiking with other families, chips with each other, and studies with published systems"
_HONEST = ("shifted", "shifted_se", "unseen", "unseen_se")  # where a study evaluates them
_SHOWN = (
    *("system", "figure", "task", "published", "corrected", "ours", "se", "low", "high", "test"),
    *("reader", "reader_se", *_HONEST),
    *("runs", "hardware", "family", "trial", "study"),
)
_ESSENTIAL = ("system", "figure", "published", "corrected", "ours")
_TELLING = ("task",)
_NOTHING = 1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments; every component of section `reports` has an option of its name."""
    parser.add_argument(
        "results", nargs="+", metavar="RESULTS", help="folders of studies, or a folder that contains some"
    )
    parser.add_argument(
        "--system",
        metavar="LETTERS",
        help="print only the rows of these published systems, by their letters in the report, e.g. A or DE",
    )
    for name, about in _reports().items():
        parser.add_argument(f"--{name}", metavar=name.upper(), help=about)
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FOLDER",
        help=f"with {_either()}, also write a folder: the comparison, figures (needs "
        "`pip install 'dse[figures]'` and Chromium) and the tables of the studies",
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
    from dse.report.gather import published, report
    from dse.skyline.constraints import ExpressionError

    studies = {study.folder.resolve(): study for text in arguments.results for study in _studies(Path(text))}
    if asked := [name for name in _reports() if getattr(arguments, name) is not None]:
        return _of_published(asked, list(studies.values()), arguments)
    if arguments.out is not None:
        raise ExpressionError(f"--out must be with {_either()}, got it alone")
    known = {letter: x for source in published().values() for letter, x in source.systems().items()}
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
    audits = {f"audit of {name}": audit_answer(audit) for name, audit in gathered.audits.items()}
    notes = [*titles, *splits_of_rows, *gathered.notes]
    shown = _with_values(columns, _SHOWN)
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


def _reports() -> dict[str, str]:
    """Return the options of section `reports`, with help; those of plugins that are not installed too."""
    missing = {
        name: f"needs plugin {plugin}"
        for plugin, sections in registry.ELSEWHERE.items()
        for name in sections.get("reports", ())
    }
    installed: Mapping[str, type[Published]] = registry.known("reports")
    return missing | {name: component.about for name, component in installed.items()}


def _either() -> str:
    return " or ".join(f"--{name}" for name in _reports())


def _of_published(names: list[str], studies: list[Study], arguments: argparse.Namespace) -> Answer:
    """Return a report of section `reports`.

    Raises:
        ExpressionError: more than one is asked for, systems or profiles are named too, or its plugin is not
            installed.
        ReportError: no study fits, or there is no such report.
    """
    from dse.report.gather import published
    from dse.skyline.constraints import ExpressionError

    name, *others = names
    if others or arguments.system is not None or arguments.hardware is not None:
        text = f"{_either()} must be without --system and --hardware, got more than one of them"
        raise ExpressionError(text)
    if missing := registry.elsewhere("reports", name):
        raise ExpressionError(f"--{name} is an option{missing}")
    out = arguments.out
    table = published()[name].table(studies, getattr(arguments, name), out)
    written = [] if out is None else [f"folder: {out}"]
    return Answer(table.rows, [*table.notes, *written], _with_values(table.rows, table.shown), all_rows=True)


def _with_values(rows: Sequence[Mapping[str, object]], columns: Sequence[str]) -> list[str]:
    """Return the columns that are not empty, without that for the name of the only study."""
    values = {name: {row.get(name) for row in rows} - {None, ""} for name in columns}
    return [name for name in columns if len(values[name]) > (name == "study")]


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
    if not known:
        raise ExpressionError("--system: no plugin of published systems is installed, such as dse-papers")
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
