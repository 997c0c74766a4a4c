"""`dse pick`: the best design point within budgets, as a bundle."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dse.cli.answer import Answer, add_format
from dse.cli.fronts import TELLING, columns, measured, records
from dse.cli.numbers import draws, fraction
from dse.cli.options import add_duty, add_hardware, add_repeats, add_targets

if TYPE_CHECKING:
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
    add_repeats(parser)
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
        help="number of samples for --confidence (default: 200)",
    )
    parser.add_argument(
        "--export",
        metavar="DIR",
        help="write the picked design to this folder as a bundle; the page of the study shows those in "
        "RESULTS/bundles, with the verdicts on their targets",
    )
    add_targets(parser)
    add_format(parser)


def answer(arguments: argparse.Namespace) -> Answer:
    """Return the picked row, or if no row meets every budget the nearest rows and by how much they miss."""
    from dse.door.choice import choose
    from dse.store import StoreError

    is_study = Path(arguments.results).is_dir()
    if arguments.export and not is_study:
        raise StoreError(f"{arguments.results}: only a design of a study's folder can be exported")
    if arguments.verify and not (arguments.target and arguments.export):
        raise StoreError("--verify needs --target NAME, the target to run, and --export DIR, its folder")
    choice = choose(
        arguments.results,
        arguments.budget,
        arguments.maximise,
        hardware=arguments.hardware,
        confidence=arguments.confidence,
        draws=arguments.draws,
        contacts_per_hour=arguments.contacts_per_hour,
        battery_mwh=arguments.battery_mwh,
        targets=arguments.target,
        repeats=arguments.repeats,
    )
    goals, notes = choice.goals, choice.notes
    if choice.row is None:
        missed = [str(name) for name in choice.nearest.columns if str(name).startswith("missed ")]
        shown = [*columns(choice.nearest, goals), *missed]
        essential = [name for name in ("trial", *(name for name, _ in goals), *missed) if name in shown]
        return Answer(
            records(choice.nearest), notes, shown, essential, telling=TELLING, code=_NOTHING_FEASIBLE
        )
    row: dict[str, Any] = {str(name): value for name, value in choice.row.items()}
    if arguments.export and row.get("origin") == "told":
        text = f"trial {row['trial']} was measured elsewhere (`dse tell`): there is no network to export"
        raise StoreError(f"{arguments.results}: {text}")
    if arguments.export:
        from dse.cli import verdicts
        from dse.deploy.export import export
        from dse.study.results import open as open_study

        study = open_study(arguments.results)
        bundle = export(study, row, arguments.export, choice.targets, arguments.verify)
        notes = [*notes, f"bundle: {arguments.export}"]
        if bundle.targets:
            rows = [verdicts.row(name, verdict) for name, verdict in bundle.targets.items()]
            return Answer([row], notes, _shown(row, goals), sections={"targets": Answer(rows)})
    return Answer([row], notes, _shown(row, goals))


def _shown(row: dict[str, Any], goals: list[Goal]) -> list[str]:
    """Return the columns of one row that a table shows: the design and the objectives."""
    import pandas

    identity = ("trial", "family", "phi", "theta", "read_out_ms", "weight_bits", "pruned_after", "hardware")
    axes = [
        name for name, value in row.items() if "." in name and name != "model.kind" and pandas.notna(value)
    ]
    design = [name for name in row if name in identity or name in axes]
    on_target = ("target", "ram_bytes", "table_bytes", "flash_bytes", "cycles")
    optional = ("power_mw", "battery_h", "front_share", "confidence", *on_target)
    numbers = measured(pandas.DataFrame([row]), [name for name, _ in goals])
    return [name for name in dict.fromkeys([*numbers, *design, *optional]) if name in row]
