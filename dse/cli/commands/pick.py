"""`dse pick`: the best design point within budgets, as a bundle."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from dse.cli.answer import FORMATS, Answer
from dse.cli.fields import argument, formats, hidden, option
from dse.cli.fronts import TELLING, columns, records
from dse.cli.options import Verifying, question_of
from dse.door.question import Question

GROUP = "choose"
HELP = "pick the best design point that meets all budgets, and export it as a bundle"
_NOTHING_FEASIBLE = 3


@dataclass(frozen=True, kw_only=True)
class Arguments(Verifying, Question):
    """The arguments."""

    results: str = argument("RESULTS", "folder of a study, or a CSV, Parquet or JSON table")
    budget: tuple[str, ...] = option(
        "EXPR", 'condition that the pick must meet, e.g. "energy_uj<=50"; repeatable', ()
    )
    maximise: str | None = option(
        "COLUMN", "column to maximise (default: the first objective that is maximised; of a table, accuracy)"
    )
    export: str | None = option(
        "DIR",
        "write the picked design to this folder as a bundle; the page of the study shows those in "
        "RESULTS/bundles, with the verdicts on their targets",
    )
    target: tuple[str, ...] = option("NAME", "target to write (`dse describe targets`); repeatable", ())
    format: str | None = formats(FORMATS)
    targets: tuple[str, ...] = hidden(())


def answer(arguments: Arguments) -> Answer:
    """Return the picked row, or if no row meets every budget the nearest rows and by how much they miss."""
    from dse.door.choice import choose
    from dse.store import StoreError

    is_study = Path(arguments.results).is_dir()
    if arguments.export and not is_study:
        raise StoreError(f"{arguments.results}: only a design of a study's folder can be exported")
    if arguments.verify and not (arguments.target and arguments.export):
        raise StoreError("--verify needs --target NAME, the target to run, and --export DIR, its folder")
    choice = choose(
        arguments.results, arguments.budget, arguments.maximise, question_of(arguments, arguments.target)
    )
    if choice.row is None:
        missed = [str(name) for name in choice.nearest.columns if str(name).startswith("missed ")]
        shown = [*columns(choice.nearest, choice.goals), *missed]
        essential = [
            name for name in ("trial", *(name for name, _ in choice.goals), *missed) if name in shown
        ]
        return Answer(
            records(choice.nearest), choice.notes, shown, essential, TELLING, code=_NOTHING_FEASIBLE
        )
    if not arguments.export:
        return Answer([dict(choice)], choice.notes, list(choice.shown))
    from dse.cli import verdicts

    bundle = choice.export(arguments.export, recordings=arguments.verify)
    rows = [verdicts.row(name, verdict) for name, verdict in bundle.targets.items()]
    return Answer(
        [dict(choice)],
        [*choice.notes, f"bundle: {arguments.export}"],
        list(choice.shown),
        sections={"targets": Answer(rows)} if rows else {},
    )
