"""`dse pick`: the best design point within budgets, as a bundle."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dse.cli import priced
from dse.cli.answer import Answer, add_format
from dse.cli.fronts import Objective, columns, records
from dse.cli.numbers import draws, share
from dse.study import priced as study_priced

if TYPE_CHECKING:
    import pandas

HELP = "pick the best design point within budgets, and export it"
_NOTHING_FEASIBLE = 3


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        "results", metavar="RESULTS", help="folder of a study, or a CSV, Parquet or JSON file"
    )
    parser.add_argument(
        "--budget", action="append", default=[], metavar="EXPR", help='such as "energy_uj<=50"; repeatable'
    )
    parser.add_argument("--maximise", default="accuracy", metavar="COLUMN", help="default: accuracy")
    priced.add_hardware(parser)
    priced.add_duty(parser)
    parser.add_argument(
        "--confidence",
        type=share,
        metavar="SHARE",
        help="such as 0.9: in so many draws of the hardware's figures the pick is within each budget, and no "
        "design beats it in every objective",
    )
    parser.add_argument(
        "--draws", type=draws, default=200, metavar="N", help="draws for --confidence (default: 200)"
    )
    parser.add_argument("--export", metavar="DIR", help="write the design as a bundle")
    add_format(parser)


def answer(arguments: argparse.Namespace) -> Answer:
    """Return the picked row; without one, the nearest rows and by how much they miss each budget."""
    from dse.skyline import front
    from dse.store import StoreError
    from dse.study import results

    is_study = Path(arguments.results).is_dir()
    if arguments.export and not is_study:
        raise StoreError(f"{arguments.results}: only a design of a study's folder can be exported")
    [points] = study_priced.points([arguments.results], arguments.hardware)
    points = study_priced.on_duty(points, arguments.contacts_per_hour, arguments.battery_mwh)
    objectives: list[Objective] = results.open(arguments.results).objectives if is_study else []
    ties = [(name, way) for name, way in objectives if name != arguments.maximise and name in points]
    goals = [(arguments.maximise, "max"), *ties]
    if arguments.confidence is None:
        found = front.pick(points, arguments.budget, arguments.maximise, ties)
    else:
        names = [*(name for name, _ in goals), *front.budgeted(arguments.budget)]
        drawing = study_priced.draws(
            [arguments.results], [points], arguments.hardware, names, arguments.draws
        )
        apart = [name for name in ("task",) if name in points]
        found = front.sure_pick(
            points, arguments.budget, arguments.maximise, ties, drawing, arguments.confidence, apart
        )
    if found.row is None:
        missed = [str(name) for name in found.nearest.columns if str(name).startswith("missed ")]
        sure = "" if arguments.confidence is None else f" in {arguments.confidence:.0%} of the draws"
        notes = [f"no design point is within the budgets{sure}; these come nearest", *found.notes]
        shown = [*columns(found.nearest, goals), *missed]
        return Answer(records(found.nearest), notes, shown, code=_NOTHING_FEASIBLE)
    row: dict[str, Any] = {str(name): value for name, value in found.row.items()}
    # Accuracies of tasks do not compare; nor do energies of a chip and of counted operations.
    notes = [
        *found.notes,
        *_unheld(row),
        *_others(points, arguments.budget, "task", "tasks"),
        *_others(points, arguments.budget, "hardware", "hardware profiles"),
    ]
    if arguments.export:
        from dse.deploy import evaluate

        evaluate.export(results.open(arguments.results), row, arguments.export)
        notes.append(f"bundle: {arguments.export}")
    return Answer([row], notes, _telling(row, goals))


def _unheld(row: dict[str, Any]) -> list[str]:
    """Return a hint where the pick's chip cannot run it or hold it."""
    import pandas

    if "energy_uj_high" in row and pandas.isna(row["energy_uj_high"]):
        return [f'{row["hardware"]} cannot run this design; --budget "energy_uj_high >= 0" leaves such out']
    if pandas.notna(row.get("fits")) and not row["fits"]:
        return [f"this design does not fit {row['hardware']}; --budget fits leaves such out"]
    return []


def _others(points: pandas.DataFrame, budgets: list[str], column: str, plural: str) -> list[str]:
    """Return a hint where the pick went across values of a column whose rows do not compare."""
    values = list(dict.fromkeys(map(str, points[column]))) if column in points else []
    if len(values) < 2 or any(column in budget for budget in budgets):
        return []
    return [
        f"best over the {plural} {', '.join(values)}; --budget \"{column} == '{values[0]}'\" picks within one"
    ]


def _telling(row: dict[str, Any], goals: list[Objective]) -> list[str]:
    """Return the columns of one row that a table shows: the design and the objectives."""
    import pandas

    about = ("trial", "family", "phi", "theta", "read_out_ms", "weight_bits", "pruned_after", "hardware")
    axes = [
        name for name, value in row.items() if "." in name and name != "model.kind" and pandas.notna(value)
    ]
    design = [name for name in row if name in about or name in axes]
    asked = ("power_mw", "battery_h", "front_share")
    return [name for name in dict.fromkeys([*design, *(goal for goal, _ in goals), *asked]) if name in row]
