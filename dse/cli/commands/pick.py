"""`dse pick`: the best design point within budgets, as a bundle."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dse.cli.answer import Answer, add_format
from dse.cli.fronts import columns, records
from dse.cli.numbers import draws, fraction
from dse.cli.options import add_duty, add_hardware, add_targets

if TYPE_CHECKING:
    import pandas

    from dse.skyline.goals import Goal

GROUP = "choose"
HELP = "pick the best design point that meets all budgets, and export it as a bundle"
_NOTHING_FEASIBLE = 3


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        "results", metavar="RESULTS", help="folder of a study, or a CSV, Parquet or JSON table"
    )
    parser.add_argument(
        "--budget",
        action="append",
        default=[],
        metavar="EXPR",
        help='condition that the pick must meet, e.g. "energy_uj<=50"; repeatable',
    )
    parser.add_argument(
        "--maximise", default="accuracy", metavar="COLUMN", help="column to maximise (default: accuracy)"
    )
    add_hardware(parser)
    add_duty(parser)
    parser.add_argument(
        "--confidence",
        type=fraction,
        metavar="P",
        help="require confidence, e.g. 0.9: in 90 %% of the samples of recordings, seeds and the chip's "
        "uncertain numbers the pick meets all budgets at once and is non-dominated",
    )
    parser.add_argument(
        "--draws",
        type=draws,
        default=200,
        metavar="N",
        help="number of samples for --confidence and the corrected accuracy (default: 200)",
    )
    parser.add_argument("--export", metavar="DIR", help="write the picked design to this folder as a bundle")
    add_targets(parser)
    add_format(parser)


def answer(arguments: argparse.Namespace) -> Answer:
    """Return the picked row, or if no row meets every budget the nearest rows and by how much they miss."""
    from dse.skyline.goals import Goal
    from dse.skyline.pick import budgeted, pick, sure_pick
    from dse.store import StoreError
    from dse.study import pricing, resampling, results

    is_study = Path(arguments.results).is_dir()
    if arguments.export and not is_study:
        raise StoreError(f"{arguments.results}: only a design of a study's folder can be exported")
    if arguments.verify and not (arguments.target and arguments.export):
        raise StoreError("--verify needs --target NAME, the target to run, and --export DIR, its folder")
    if arguments.target and not is_study:
        raise StoreError(f"{arguments.results}: only designs of a study's folder have targets")
    [points] = pricing.tables([arguments.results], arguments.hardware)
    points = pricing.on_duty(points, arguments.contacts_per_hour, arguments.battery_mwh)
    targets, remarks = _targets(arguments), list[str]()
    if targets:
        from dse.deploy.footprints import on_targets

        points, remarks = on_targets(results.open(arguments.results), points, targets)
    objectives: list[Goal] = results.open(arguments.results).objectives if is_study else []
    ties = [goal for goal in objectives if goal.column != arguments.maximise and goal.column in points]
    goals = [Goal(arguments.maximise, "max"), *ties]
    if arguments.confidence is None:
        picked = pick(points, arguments.budget, arguments.maximise, ties)
    else:
        names = budgeted(arguments.budget)
        drawing = resampling.draws(
            [arguments.results], [points], arguments.hardware, goals, arguments.draws, names
        )
        apart = [name for name in ("task",) if name in points]
        picked = sure_pick(
            points, arguments.budget, arguments.maximise, ties, drawing, arguments.confidence, apart
        )
    if picked.row is None:
        missed = [str(name) for name in picked.nearest.columns if str(name).startswith("missed ")]
        sure = "" if arguments.confidence is None else f" in {arguments.confidence:.0%} of the samples"
        notes = [f"no design point meets every budget{sure}; the nearest are shown", *picked.notes, *remarks]
        shown = [*columns(picked.nearest, goals), *missed]
        essential = [name for name in ("trial", *(name for name, _ in goals), *missed) if name in shown]
        return Answer(records(picked.nearest), notes, shown, essential, code=_NOTHING_FEASIBLE)
    row: dict[str, Any] = {str(name): value for name, value in picked.row.items()}
    # Accuracies on different tasks cannot be compared, nor can energies on different hardware.
    notes = [
        *picked.notes,
        *remarks,
        *(_corrected(row, points, arguments, ties) if is_study else []),
        *_misfit(row),
        *_others(points, arguments.budget, "task", "tasks"),
        *_others(points, arguments.budget, "hardware", "hardware profiles"),
        *_others(points, arguments.budget, "target", "targets"),
    ]
    if arguments.export:
        from dse.cli import verdicts
        from dse.deploy.export import export

        study = results.open(arguments.results)
        bundle = export(study, row, arguments.export, targets, arguments.verify)
        notes.append(f"bundle: {arguments.export}")
        if bundle.targets:
            rows = [verdicts.row(name, verdict) for name, verdict in bundle.targets.items()]
            return Answer([row], notes, _shown(row, goals), sections={"targets": Answer(rows)})
    return Answer([row], notes, _shown(row, goals))


def _targets(arguments: argparse.Namespace) -> list[str]:
    """Return the targets that are named, or else those of the study's search space."""
    from dse.study import results

    if arguments.target or not Path(arguments.results).is_dir():
        return list(arguments.target)
    return list(results.open(arguments.results).space.get("targets", ()))


def _corrected(
    row: dict[str, Any], points: pandas.DataFrame, arguments: argparse.Namespace, ties: list[Goal]
) -> list[str]:
    """Add to a row its accuracy corrected for having been chosen as the best, and return a note on it."""
    from dse.skyline.pick import contestants
    from dse.store import StoreError
    from dse.study import resampling

    name = arguments.maximise
    if name not in resampling.ACCURACIES:
        return []
    among = contestants(points, arguments.budget, name, ties)
    try:
        gained = resampling.optimism_of(Path(arguments.results), among, name, arguments.draws)
    except StoreError as error:
        return [f"no corrected {name}: {error}"]
    row[f"{name}_corrected"] = row[name] - gained
    return [
        f"{name} {row[name]:.3f} is the best of {len(among)} points of {among['trial'].nunique()} designs; "
        f"corrected for that choice it is {row[f'{name}_corrected']:.3f}"
    ]


def _misfit(row: dict[str, Any]) -> list[str]:
    """Return a hint if the chip cannot run the picked design, or the design does not fit it."""
    import pandas

    if "energy_uj_high" in row and pandas.isna(row["energy_uj_high"]):
        return [
            f"{row['hardware']} cannot run this design; "
            'exclude such designs with --budget "energy_uj_high >= 0"'
        ]
    if pandas.notna(row.get("fits")) and not row["fits"]:
        return [f"this design does not fit {row['hardware']}; exclude such designs with --budget fits"]
    return []


def _others(points: pandas.DataFrame, budgets: list[str], column: str, plural: str) -> list[str]:
    """Return a hint if the pick compared rows that differ in a column whose values cannot be compared."""
    from dse.skyline.constraints import named_columns

    values = list(dict.fromkeys(map(str, points[column]))) if column in points else []
    if len(values) < 2 or column in named_columns(budgets):
        return []
    return [
        f"this is the best over the {plural} {', '.join(values)}; restrict it to one with "
        f"--budget \"{column} == '{values[0]}'\""
    ]


def _shown(row: dict[str, Any], goals: list[Goal]) -> list[str]:
    """Return the columns of one row that a table shows: the design and the objectives."""
    import pandas

    identity = ("trial", "family", "phi", "theta", "read_out_ms", "weight_bits", "pruned_after", "hardware")
    axes = [
        name for name, value in row.items() if "." in name and name != "model.kind" and pandas.notna(value)
    ]
    design = [name for name in row if name in identity or name in axes]
    on_target = ("target", "ram_bytes", "table_bytes", "cycles")
    optional = ("power_mw", "battery_h", "front_share", "confidence", *on_target)
    measured = [name for goal, _ in goals for name in (goal, f"{goal}_corrected")]
    return [name for name in dict.fromkeys([*design, *measured, *optional]) if name in row]
