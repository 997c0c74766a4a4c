"""A front as an answer: all columns as data, the telling ones on a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from dse.cli.answer import Answer

if TYPE_CHECKING:
    import pandas

Objective = tuple[str, str]

# Columns beside the axes that tell rows apart.
_ABOUT = ("phi", "theta", "read_out_ms", "weight_bits", "pruned_after", "hardware", "fits", "task", "family")


def front(
    points: pandas.DataFrame, objectives: Sequence[Objective], where: str | None = None, by: str | None = None
) -> Answer:
    """Return the non-dominated rows of a table of points (`dse.skyline.front.skyline`)."""
    from dse.skyline.front import skyline

    found = skyline(points, objectives, where, by)
    return Answer(records(found.rows), found.notes, columns(found.rows, objectives))


def records(frame: pandas.DataFrame) -> list[dict[str, Any]]:
    """Return the rows of a table, each keyed by column name."""
    return [{str(name): value for name, value in row.items()} for row in frame.to_dict("records")]


def columns(rows: pandas.DataFrame, objectives: Sequence[Objective]) -> list[str]:
    """Return the columns that tell designs apart, and the objectives with what belongs to accuracy."""
    names = [name for name, _ in objectives]
    if "accuracy" in names:
        extra = [
            name for name in ("accuracy_se", "accuracy_test") if name in rows and rows[name].notna().any()
        ]
        place = names.index("accuracy") + 1
        names[place:place] = [name for name in extra if name not in names]
    # An axis of one family says little in a table of several; every other format has it.
    # Columns of missed budgets may have a point in their numbers; no axis has a space.
    dotted = [name for name in map(str, rows.columns) if "." in name and " " not in name]
    axes = [name for name in dotted if rows[name].notna().all()]
    if "family" in rows:  # says the same, of studies of a single family too
        axes = [name for name in axes if name != "model.kind"]
    parameters = [name for name in map(str, rows.columns) if name in axes or name in _ABOUT]
    varied = [name for name in parameters if rows[name].astype(str).nunique(dropna=False) > 1]
    chosen = [*(["trial"] if "trial" in rows else []), *varied, *names]
    return [name for name in dict.fromkeys(chosen) if name in rows]
