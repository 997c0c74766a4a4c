"""A front as an answer: every column as data, the columns that differ on a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from dse.cli.answer import MOST_ROWS, Answer

if TYPE_CHECKING:
    import pandas

    from dse.skyline.goals import Goal

# Columns beside the axes that identify a design point.
_IDENTITY = (
    "phi",
    "theta",
    "read_out_ms",
    "weight_bits",
    "pruned_after",
    "hardware",
    "fits",
    "task",
    "family",
)

_OF_WEIGHTS = ("weight_bits", "pruned_after")

GROUPS = ("hardware", "task")
"""Columns without which rows of a table cannot be compared."""

TELLING = (*GROUPS, "phi", "theta", "read_out_ms", *_OF_WEIGHTS)
"""Columns without which rows of a trial cannot be told apart."""

_MUCH = 2.0  # times the energy

POINTS = "points"
"""Column of a table on a terminal: how many points of a trial have these objectives."""


def front(points: pandas.DataFrame, objectives: Sequence[Goal]) -> Answer:
    """Return the non-dominated rows of a table of points (`dse.skyline.front.skyline`)."""
    from dse.skyline.front import skyline

    rows, notes = skyline(points, objectives)
    return front_answer(rows, objectives, notes)


def front_answer(
    rows: pandas.DataFrame, objectives: Sequence[Goal], notes: Sequence[str], beside: Sequence[str] = ()
) -> Answer:
    """Return the rows of a front; a terminal shows equal points of a trial as one row.

    Args:
        rows: of the front.
        objectives: that it is of.
        notes: on it.
        beside: further columns to show.
    """
    from dse.skyline.front import front_columns
    from dse.skyline.goals import costs_of
    from dse.skyline.pareto import most_telling
    from dse.skyline.table import group_numbers

    if rows.empty:
        return Answer([], [*notes, "no design point is left"], list(map(str, rows.columns)))
    table = without_equals(rows, objectives)
    shown = columns(table, objectives)
    if len(table) < len(rows):
        shown.append(POINTS)
        notes = [
            *notes,
            f"{POINTS}: how many points of a trial are equal in all objectives; the one shown has the "
            "least latency, then energy, then weights",
        ]
    notes = [*notes, *_waiting(rows, shown)]
    shown += [name for name in beside if name in rows and name not in shown]
    best_known = (f"{name}_corrected" if f"{name}_corrected" in shown else name for name, _ in objectives)
    essential = [name for name in ("trial", *best_known) if name in shown]

    def best() -> list[int]:
        group = group_numbers(table, front_columns(table, None))
        places: list[int] = most_telling(costs_of(table, objectives), group, MOST_ROWS).tolist()
        return places

    return Answer(
        *(records(rows), notes, shown, essential),
        telling=TELLING,
        groups=GROUPS,
        table=records(table),
        best=best,
    )


def _waiting(rows: pandas.DataFrame, shown: Sequence[str]) -> list[str]:
    """Return how much more energy rows take at the sensor's period; a narrow terminal drops that column."""
    if "energy_throttled_uj" not in shown:
        return []
    times = (rows["energy_throttled_uj"] / rows["energy_uj"].where(rows["energy_uj"] > 0)).max()
    if not times > _MUCH:
        return []
    text = f"{times:.0f}" if times >= 100 else f"{times:.2g}"
    return [
        f"energy_uj is at full speed; at the sensor's period up to {text} times as much: energy_throttled_uj"
    ]


def without_equals(rows: pandas.DataFrame, objectives: Sequence[Goal]) -> pandas.DataFrame:
    """Return one row for the points of a trial that are equal in all objectives, with their number."""
    from dse.skyline.pick import economy

    if "trial" not in rows:
        return rows
    alike = [x for x in ("trial", "task", "hardware", "weight_bits", "pruned_after") if x in rows]
    alike += [name for name, _ in objectives if name not in alike]
    ordered = rows.sort_values([goal.column for goal in economy(rows)] or alike, kind="stable")
    groups = ordered.groupby(alike, sort=False, dropna=False, observed=True)
    first = ordered.assign(**{POINTS: groups["trial"].transform("size")}).drop_duplicates(alike)
    return first.loc[[index for index in rows.index if index in first.index]]


def records(frame: pandas.DataFrame) -> list[dict[str, object]]:
    """Return the rows of a table, each keyed by column name."""
    return [{str(name): value for name, value in row.items()} for row in frame.to_dict("records")]


def columns(rows: pandas.DataFrame, objectives: Sequence[Goal]) -> list[str]:
    """Return the columns in which designs differ, and the objectives with what stands beside them."""
    from dse.api.front import measured

    names = measured(rows, [name for name, _ in objectives])
    # An axis that only one family has is left out of a table of several; the other formats have every column.
    # Axes have a point in their names; names of missed budgets may have one too, but also a space.
    dotted = [name for name in map(str, rows.columns) if "." in name and " " not in name]
    axes = [name for name in dotted if rows[name].notna().all()]
    if "family" in rows:  # the same, and also in studies of a single family
        axes = [name for name in axes if name != "model.kind"]
    parameters = [name for name in map(str, rows.columns) if name in axes or name in _IDENTITY]
    # Without weights of so many bits, a family has no such setting: it is no other one.
    texts = {
        name: tuple((rows[name].dropna() if name in _OF_WEIGHTS else rows[name]).astype(str))
        for name in parameters
    }
    varied = [name for name, values in texts.items() if len(set(values)) > 1]
    if "task" in varied and texts.get("task.target") == texts["task"]:
        varied.remove("task.target")
    chosen = [*(["trial"] if "trial" in rows else []), *varied, *names]
    return [name for name in dict.fromkeys(chosen) if name in rows]
