"""A front as an answer: every column as data, the columns that differ on a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from dse.cli.answer import Answer

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


def front(
    points: pandas.DataFrame, objectives: Sequence[Goal], where: str | None = None, by: str | None = None
) -> Answer:
    """Return the non-dominated rows of a table of points (`dse.skyline.front.skyline`)."""
    from dse.skyline.front import skyline

    non_dominated = skyline(points, objectives, where, by)
    rows = non_dominated.rows
    return Answer(records(rows), non_dominated.notes, columns(rows, objectives))


def records(frame: pandas.DataFrame) -> list[dict[str, object]]:
    """Return the rows of a table, each keyed by column name."""
    return [{str(name): value for name, value in row.items()} for row in frame.to_dict("records")]


def columns(rows: pandas.DataFrame, objectives: Sequence[Goal]) -> list[str]:
    """Return the columns in which designs differ, and the objectives (accuracy with error and test value)."""
    names = [name for name, _ in objectives]
    if "accuracy" in names:
        extra = [
            name for name in ("accuracy_se", "accuracy_test") if name in rows and rows[name].notna().any()
        ]
        place = names.index("accuracy") + 1
        names[place:place] = [name for name in extra if name not in names]
    # An axis that only one family has is left out of a table of several; the other formats have every column.
    # Axes have a point in their names; names of missed budgets may have one too, but also a space.
    dotted = [name for name in map(str, rows.columns) if "." in name and " " not in name]
    axes = [name for name in dotted if rows[name].notna().all()]
    if "family" in rows:  # the same, and also in studies of a single family
        axes = [name for name in axes if name != "model.kind"]
    parameters = [name for name in map(str, rows.columns) if name in axes or name in _IDENTITY]
    varied = [name for name in parameters if rows[name].astype(str).nunique(dropna=False) > 1]
    chosen = [*(["trial"] if "trial" in rows else []), *varied, *names]
    return [name for name in dict.fromkeys(chosen) if name in rows]
