"""The best design point within budgets, with all that can be asked for: chips, confidence, duty, targets."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from dse.skyline.constraints import ExpressionError, named_columns
from dse.skyline.goals import Goal
from dse.skyline.pick import budgeted, contestants, pick, sure_pick
from dse.store import StoreError
from dse.study import held, pricing, resampling
from dse.study.repeats import over_repeats
from dse.study.results import open as open_study

if TYPE_CHECKING:
    import pandas


class Choice(NamedTuple):
    """The best design point within the budgets, or the nearest ones.

    row: its columns, None if no point meets every budget; `accuracy_corrected` is corrected for the choice.
    nearest: in that case, the nearest points, as of `dse.skyline.pick.Pick`.
    notes: what was left out, what decided, and what to look at.
    goals: what was maximised, then what decided between equals.
    targets: that the points were looked at on.
    """

    row: pandas.Series[Any] | None
    nearest: pandas.DataFrame
    notes: list[str]
    goals: list[Goal]
    targets: list[str]


def choose(
    results: str | Path,
    budgets: Sequence[str] = (),
    maximise: str = "accuracy",
    *,
    hardware: Sequence[str] = (),
    confidence: float | None = None,
    draws: int = 200,
    contacts_per_hour: float | None = None,
    battery_mwh: float | None = None,
    targets: Sequence[str] = (),
    repeats: str = "mean",
) -> Choice:
    """Return the best design point of a study, or of a table, within budgets.

    Args:
        results: folder of a study, or a CSV, Parquet or JSON table.
        budgets: conditions such as "energy_uj <= 50 and n_weights <= 150000".
        maximise: column to maximise.
        hardware: profiles, by name or file, to compute costs on; empty: those of the study.
        confidence: fraction of the samples in which the point must be within all budgets and on the front.
        draws: number of samples, for this and for the corrected accuracy.
        contacts_per_hour: inferences per hour, for columns power_mw and battery_h.
        battery_mwh: capacity of the battery.
        targets: names of targets whose memory and cycles budgets may name; empty: those of the study.
        repeats: of a design with several runs, 'mean' of all, or the 'last' or 'worst' run alone.

    Raises:
        ExpressionError: an unknown column, or a budget that cannot be read.
        StoreError: the study is damaged.
        BundleError: a target is unknown.
    """
    is_study = Path(results).is_dir()
    if targets and not is_study:
        raise StoreError(f"{results}: only designs of a study's folder have targets")
    [points] = pricing.tables([results], list(hardware))
    if repeats != "mean":
        if confidence is not None:
            raise ExpressionError(f"repeats {repeats} is one run of each design: samples are over all runs")
        pricing.check_studies([results], "repeats needs")
        points = over_repeats(Path(results), points, repeats)
    points = pricing.on_duty(points, contacts_per_hour, battery_mwh)
    remarks = held.remarks(Path(results))
    if is_study and not targets:
        targets = list(open_study(results).space.get("targets", ()))
    if targets:
        from dse.deploy.footprints import on_targets

        points, on_target = on_targets(open_study(results), points, targets)
        remarks += on_target
    objectives: list[Goal] = open_study(results).objectives if is_study else []
    ties = [goal for goal in objectives if goal.column != maximise and goal.column in points]
    goals = [Goal(maximise, "max"), *ties]
    if confidence is None:
        picked = pick(points, budgets, maximise, ties)
    else:
        drawing = resampling.draws([results], [points], list(hardware), goals, draws, budgeted(budgets))
        apart = [name for name in ("task",) if name in points]
        picked = sure_pick(points, budgets, maximise, ties, drawing, confidence, apart)
    if picked.row is None:
        sure = "" if confidence is None else f" in {confidence:.0%} of the samples"
        notes = [f"no design point meets every budget{sure}; the nearest are shown", *picked.notes, *remarks]
        return Choice(None, picked.nearest, notes, goals, list(targets))
    row = picked.row.copy()
    corrected = []
    if is_study and repeats == "mean":  # one run is no sample of seeds
        corrected = _corrected(row, Path(results), points, budgets, maximise, ties, draws)
    # Accuracies on different tasks cannot be compared, nor can energies on different hardware.
    notes = [
        *picked.notes,
        *remarks,
        *corrected,
        *_misfit(row),
        *_others(points, budgets, "task", "tasks"),
        *_others(points, budgets, "hardware", "hardware profiles"),
        *_others(points, budgets, "target", "targets"),
    ]
    return Choice(row, picked.nearest, notes, goals, list(targets))


def _corrected(
    row: pandas.Series[Any],
    folder: Path,
    points: pandas.DataFrame,
    budgets: Sequence[str],
    name: str,
    ties: list[Goal],
    draws: int,
) -> list[str]:
    """Add to a row its accuracy corrected for having been chosen as the best, and return a note on it."""
    if name not in resampling.ACCURACIES:
        return []
    among, stopped = contestants(points, budgets, name, ties), points.iloc[:0]
    try:
        if name == "accuracy":
            chips = [str(x) for x in points["hardware"].dropna().unique()] if "hardware" in points else []
            rows = resampling.stopped_rows(folder, open_study(folder).trials, chips)
            if len(rows):
                stopped = contestants(rows.reindex(columns=points.columns), budgets, name, ties)
        gained = resampling.optimism_of(folder, among, name, draws, stopped)
    except StoreError as error:
        return [f"no corrected {name}: {error}"]
    row[f"{name}_corrected"] = row[name] - gained
    n_designs, n_stopped = among["trial"].nunique(), stopped["trial"].nunique()
    designs = "1 design" if n_designs == 1 else f"{n_designs} designs"
    beside = f" and {n_stopped} that racing stopped" if n_stopped else ""
    return [
        f"{name} {row[name]:.3f} is the best of {len(among)} points of {designs}{beside}; "
        f"corrected for that choice it is {row[f'{name}_corrected']:.3f}"
    ]


def _misfit(row: pandas.Series[Any]) -> list[str]:
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


def _others(points: pandas.DataFrame, budgets: Sequence[str], column: str, plural: str) -> list[str]:
    """Return a hint if the pick compared rows that differ in a column whose values cannot be compared."""
    values = list(dict.fromkeys(map(str, points[column]))) if column in points else []
    if len(values) < 2 or column in named_columns(budgets):
        return []
    return [
        f"this is the best over the {plural} {', '.join(values)}; restrict it to one with "
        f"--budget \"{column} == '{values[0]}'\""
    ]
