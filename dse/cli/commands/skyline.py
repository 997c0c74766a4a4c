"""`dse skyline`: the Pareto front of studies or tables, under constraints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dse.cli.answer import FORMATS, Answer
from dse.cli.fields import argument, flag, formats, hidden, option
from dse.cli.fronts import front_answer
from dse.cli.options import question_of
from dse.door.question import Question

if TYPE_CHECKING:
    import pandas

    from dse.skyline.goals import Goal

_IN_MEMORY = 4_000_000  # rows of a table that is read whole

GROUP = "choose"
HELP = "print the skyline: the non-dominated design points of studies or of any tables"


@dataclass(frozen=True, kw_only=True)
class Arguments(Question):
    """The arguments."""

    results: tuple[str, ...] = argument(
        "RESULTS", "folder of a study, or a CSV, Parquet or JSON table; several are concatenated"
    )
    objectives: str | None = option(
        "LIST", "e.g. accuracy:max,energy_uj:min (default: the objectives of the study)"
    )
    where: tuple[str, ...] = option(
        "EXPR",
        'keep the points that meet this condition, e.g. "n_weights <= 100000 and phi > 2"; repeatable: all '
        "must be met",
        (),
    )
    by: str | None = option(
        "COLUMN",
        "compute one front per value of this column, e.g. task; separate several columns by commas. Costs "
        "on different hardware are never compared",
    )
    notes: bool = flag("show the notes on designs (`dse note`): columns note and pinned")
    format: str | None = formats(FORMATS)
    targets: tuple[str, ...] = hidden(())


def answer(arguments: Arguments) -> Answer:
    """Return the front of all the tables together."""
    from dse.door.front import ADDED, front_of
    from dse.skyline import blocks
    from dse.study import corrected, held

    objectives = objectives_of(arguments.objectives, arguments.results[0])
    question = question_of(arguments)
    by = [name.strip() for name in (arguments.by or "").split(",") if name.strip()]
    if (large := _large(arguments, question)) is not None:
        rows, notes = blocks.parquet_skyline(large, objectives, arguments.where, by)
        notes = [*notes, *corrected.lacking(rows, (name for name, _ in objectives))]
        notes += held.remarks(Path(arguments.results[0]))
    else:
        rows, notes = front_of(arguments.results, objectives, arguments.where, by, question)
    beside = list(ADDED)
    if arguments.notes:
        rows, beside = _with_notes(rows, arguments.results), [*beside, "pinned", "note"]
    return front_answer(rows, objectives, notes, beside)


def _with_notes(rows: pandas.DataFrame, results: Sequence[str]) -> pandas.DataFrame:
    from dse.store import StoreError
    from dse.study.notes import with_notes

    if len(results) > 1 or not Path(results[0]).is_dir():
        raise StoreError(f"{results[-1]}: --notes needs one study's folder")
    return with_notes(rows, Path(results[0]))


def _large(arguments: Arguments, question: Question) -> Path | None:
    """Return the file of a table that is too large for memory, if its front needs nothing but its columns."""
    import pyarrow.parquet

    path = Path(arguments.results[0])
    file = path / "points.parquet" if path.is_dir() else path
    asks = question != Question() or arguments.notes
    if len(arguments.results) > 1 or asks or file.suffix != ".parquet" or not file.is_file():
        return None
    try:
        n_rows = pyarrow.parquet.read_metadata(file).num_rows
    except (OSError, ValueError):  # the reader of tables says why
        return None
    return file if n_rows > _IN_MEMORY else None


def objectives_of(text: str | None, results: str) -> list[Goal]:
    """Return the objectives of the option `--objectives`, or those of the study if the option is absent.

    Raises:
        ExpressionError: the objectives cannot be parsed, or a table has none.
    """
    from dse.skyline.constraints import ExpressionError
    from dse.skyline.goals import parse_goals
    from dse.skyline.table import TableError
    from dse.study.results import open as open_study

    if text is not None:
        return parse_goals(text)
    if not Path(results).exists():
        raise TableError(f"{results}: no such file")
    if not Path(results).is_dir():
        raise ExpressionError(
            f"{results}: a table has no objectives of its own; state them: --objectives accuracy:max,..."
        )
    return open_study(results).objectives
