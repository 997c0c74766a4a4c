"""A front as an answer: its default view has the columns that designs are chosen by."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING

from dse.cli.answer import MOST_ROWS, Answer, wrapped

if TYPE_CHECKING:
    import pandas

    from dse.skyline.rivals import Rivals
    from dse.skyline.table import Goal

RIVALS = "Should it spike?"
"""Title of the section that says whether to spike."""

MOST_COLUMNS = 30
"""Columns of the default view of a table of points."""

_IDENTITY = ("study", "trial", "task", "family", "hardware")
_SETTINGS = ("phi", "theta", "read_out_ms", "weight_bits", "pruned_after")
# What designs are chosen by beside the objectives; a terminal shows an interval with its number.
_CHOSEN_BY = (
    *("accuracy_corrected", "accuracy_corrected_low", "accuracy_corrected_high", "accuracy", "accuracy_se"),
    *("n_weights", "spikes_per_inference", "decision_latency_ms"),
    *("energy_uj", "energy_uj_low", "energy_uj_high", "latency_ms", "point"),
)

GROUPS = ("hardware", "task")
"""Columns without which rows of a table cannot be compared."""

TELLING = (*GROUPS, *_SETTINGS)
"""Columns without which rows of a trial cannot be told apart."""

_MUCH = 2.0  # times the energy

POINTS = "points"
"""Column of a table on a terminal: how many points of a trial have these objectives."""


def front_answer(
    rows: pandas.DataFrame, objectives: Sequence[Goal], notes: Sequence[str], beside: Iterable[str] = ()
) -> Answer:
    """Return the rows of a front; a terminal shows equal points of a trial as one row.

    beside: columns that were asked for, where rows have them.
    """
    from dse.skyline.front import front_columns
    from dse.skyline.pareto import most_telling
    from dse.skyline.table import costs_of, group_numbers

    if rows.empty:
        return Answer([], [*notes, "no design point is left"], columns(rows, objectives, beside))
    table = without_equals(rows, objectives)
    has_equals = len(table) < len(rows)
    shown = columns(table, objectives, [*([POINTS] if has_equals else []), *beside])
    if has_equals:
        notes = [
            *notes,
            f"{POINTS}: how many points of a trial are equal in all objectives; the one shown has the "
            "least latency, then energy, then weights",
        ]
    notes = [*notes, *_waiting(rows, shown)]
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


def rivals_section(find: Callable[[], Iterable[Rivals]]) -> dict[str, Answer]:
    """Return the section that says whether to spike; none where spiking has no rivals."""
    from dse.store import StoreError
    from dse.study.rivals import worded

    try:
        several = list(find())
    except StoreError as error:  # answers of earlier versions are not stored one by one
        return {RIVALS: Answer([], text=wrapped(f"not known: {error}"))}
    text = "\n".join(wrapped(sentence) for one in several for sentence in worded(one))
    return {RIVALS: Answer([row for one in several for row in one.rows], text=text)} if several else {}


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


def columns(rows: pandas.DataFrame, objectives: Sequence[Goal], beside: Iterable[str] = ()) -> list[str]:
    """Return the default view of points: at most `MOST_COLUMNS` columns, or more that are asked for (beside).

    Objectives and what stands beside them come first.
    """
    from dse.api.front import measured

    numbers, axes = measured(rows, [name for name, _ in objectives]), _axes(rows)
    # What was pruned by 0 was not.
    settings = [x for x in _SETTINGS if x in rows and (rows.empty or rows[x].fillna(0).any())]
    settings += ["fits"] if "fits" in rows and rows["fits"].dropna().nunique() > 1 else []
    first = [x for x in dict.fromkeys([*_IDENTITY, *settings, *numbers, *beside]) if x in rows]
    others = [x for x in (*_CHOSEN_BY, *axes) if x in rows and x not in first]
    kept = {*first, *others[: max(0, MOST_COLUMNS - len(first))]}
    order = [*_IDENTITY, *settings, *numbers, *axes, *beside, *_CHOSEN_BY]
    return [name for name in dict.fromkeys(order) if name in kept]


def _axes(rows: pandas.DataFrame) -> list[str]:
    """Return the axes that all rows have and in which they differ.

    Names of axes have a point; those of missed budgets may have one too, but also a space.
    """
    dotted = [name for name in map(str, rows.columns) if "." in name and " " not in name]
    axes = [x for x in dotted if rows[x].notna().all() and rows[x].astype(str).nunique() > 1]
    if "family" in rows:  # the same
        axes = [name for name in axes if name != "model.kind"]
    if "task" in rows and "task.target" in axes and (rows["task.target"] == rows["task"]).all():
        axes.remove("task.target")
    return axes
