"""`dse compare`: two studies side by side."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dse.cli.answer import FORMATS, Answer
from dse.cli.fields import argument, formats, like, option
from dse.cli.fronts import TELLING, columns, records
from dse.door.question import Question

if TYPE_CHECKING:
    from dse.skyline.goals import Goal

GROUP = "choose"
HELP = "compare two studies: the joint front, the hypervolume of each, and gains within budgets"


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """The arguments."""

    first: str = argument("FIRST", "folder of a study, or a CSV, Parquet or JSON table")
    second: str = argument("SECOND", "folder of a study, or a CSV, Parquet or JSON table")
    objectives: str | None = option(
        "LIST", "e.g. accuracy:max,energy_uj:min (default: those of the studies, which must be the same)"
    )
    where: tuple[str, ...] = option(
        "EXPR", 'keep the points of both that meet this condition, e.g. "n_weights <= 100000"; repeatable', ()
    )
    hardware: tuple[str, ...] = like(Question, "hardware")
    html: Path | None = option("FILE", "write the page of both, as one file that opens offline")  # noqa: RUF009
    format: str | None = formats(FORMATS)


def answer(arguments: Arguments) -> Answer:
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
