"""The best design point within budgets, or the nearest points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from dse.base.records import Bools, Floats
from dse.skyline.admissible import candidates, leave_out_unmeasured, meeting
from dse.skyline.constraints import Budget, named_columns, split_budgets
from dse.skyline.front import Drawn, Draws, comparable, front_draws
from dse.skyline.table import Goal, checked_goals, costs_of, numbers

ECONOMY = (("latency_ms", "decision_latency_ms", "hardware_latency_ms"), ("energy_uj",), ("n_weights",))
"""What decides between equally good points, less being better: the first of each group with numbers."""


_VALUES_IN_NOTE = 12
_OTHER_HARDWARE = "; --hardware NAME prices the designs of a study on another"


class Pick(NamedTuple):
    """The best row within the budgets, or the nearest rows.

    row: None if no row meets every budget.
    nearest: in that case, rows ranked by `shortfall`, the sum over the budgets of miss / |limit|
        (miss itself where the limit is 0); one column `missed <budget>` each, in the budget's unit.
        A strict limit that is hit exactly is missed by 0.
    notes: the number of rows left out, and the reason.
    """

    row: pd.Series[Any] | None
    nearest: pd.DataFrame
    notes: list[str]


def pick(
    frame: pd.DataFrame,
    budgets: Sequence[str],
    maximise: str = "accuracy",
    tie_breaks: Sequence[tuple[str, str]] = (),
    n_nearest: int = 5,
    oversize: bool = False,
) -> Pick:
    """Return the best row within the budgets; if there is none, the nearest rows.

    `ties` says which of several equally good rows it is. If no row fits its hardware, the nearest are those
    that a larger one would hold.

    Args:
        frame: design points.
        budgets: conditions such as "energy_uj <= 50 and n_weights <= 150000". Comparisons of a column
            with a number are budgets; anything else (task == 'texture') is a condition never relaxed.
        maximise: column to maximise.
        tie_breaks: (column, 'max' or 'min') pairs, the other objectives in any order (`ties`).
        n_nearest: number of nearest rows; of several points of a trial on one hardware profile, only the
            nearest counts.
        oversize: admit rows that do not fit their hardware.

    Raises:
        ExpressionError: an unknown column, or a budget that cannot be read.
    """
    limits = split_budgets(budgets)[0]
    rows, ranking, notes = _candidates(frame, budgets, maximise, tie_breaks, oversize)
    feasible = _feasible(rows, limits)
    if feasible.any():
        best = int(np.lexsort((*ranking[::-1], ~feasible))[0])
        names = [goal.column for goal in ties(rows, maximise, tie_breaks)]
        decided = _decided(ranking, feasible, best, [maximise, *names])
        return Pick(rows.iloc[best], rows.iloc[:0], [*notes, *decided])
    if rows.empty and not oversize:
        rows, ranking, _ = _candidates(frame, budgets, maximise, tie_breaks, True)
    return Pick(None, _nearest(rows, limits, ranking).iloc[:n_nearest], notes)


def ties(frame: pd.DataFrame, maximise: str, tie_breaks: Sequence[tuple[str, str]]) -> list[Goal]:
    """Return the goals that decide between rows of equal `maximise`, in their order.

    The first is what `maximise` is expected to be on other recordings, `<maximise>_corrected`, where a table
    has it: of many points that measured the same, the cheapest is the luckiest. Then come the other
    objectives and `economy`. Among the objectives, what is maximised comes first, then latency, energy and
    weights, then other costs. A row without the number of a tie comes last there; rows that are equal in all
    ties are in the table's order.
    """
    expected = [Goal(x, "max") for x in (f"{maximise}_corrected",) if x in frame]
    last = economy(frame)
    frugal = [name for names in ECONOMY for name in names]
    goals = [Goal(*pair) for pair in tie_breaks if pair[0] != maximise]

    def place(goal: Goal) -> int:
        known = frugal.index(goal.column) if goal.column in frugal else len(frugal)
        return -1 if goal.direction == "max" else known

    named = {maximise, *(goal.column for goal in goals)}
    return [*expected, *sorted(goals, key=place), *(goal for goal in last if goal.column not in named)]


def economy(frame: pd.DataFrame) -> list[Goal]:
    """Return the goals that decide between equally good points: less latency, then energy, then weights."""
    goals = []
    for names in ECONOMY:
        numeric = [x for x in names if x in frame and pd.api.types.is_numeric_dtype(frame[x].dtype)]
        goals += [Goal(x, "min") for x in numeric if np.isfinite(numbers(frame, x)).any()][:1]
    return goals


def _candidates(
    frame: pd.DataFrame,
    budgets: Sequence[str],
    maximise: str,
    tie_breaks: Sequence[tuple[str, str]],
    oversize: bool,
) -> tuple[pd.DataFrame, Floats, list[str]]:
    """Return the rows that can be picked under any limits, the keys that rank them (key, row), and notes.

    Keys are minimised, the first decides first.
    """
    limits, conditions = split_budgets(budgets)
    checked_goals([(maximise, "max"), *tie_breaks])
    rows, notes = candidates(frame, conditions, named_columns(budgets), oversize)
    if rows.empty and conditions and not meeting(frame, conditions).any():
        notes.append(f"no row meets {' and '.join(conditions)}{_values(frame, conditions)}")
    compared = [maximise, *(limit.column for limit in limits)]
    rows, unmeasured = leave_out_unmeasured(rows, list(dict.fromkeys(compared)))
    costs = costs_of(rows, [Goal(maximise, "max"), *ties(rows, maximise, tie_breaks)])
    return rows, np.where(np.isfinite(costs), costs, np.inf).T, [*notes, *unmeasured]


def _values(frame: pd.DataFrame, conditions: Sequence[str]) -> str:
    """Return what the columns of text hold that conditions name, for a note that no row meets them."""
    parts = []
    for name in sorted(named_columns(conditions)):
        values = [str(value) for value in frame[name].dropna().unique()] if name in frame else []
        if 0 < len(values) <= _VALUES_IN_NOTE and not pd.api.types.is_numeric_dtype(frame[name].dtype):
            parts.append(f"; {name} is {' or '.join(values)}")
    return "".join(parts) + _OTHER_HARDWARE * ("hardware" in named_columns(conditions))


def _decided(ranking: Floats, feasible: Bools, best: int, names: Sequence[str]) -> list[str]:
    """Return a note if rows are equal in what is maximised and others decide."""
    equal = feasible & (ranking[0] == ranking[0, best])
    n_equal, deciding = int(equal.sum()), []
    for name, key in zip(names[1:], ranking[1:], strict=True):
        left = equal & (key == key[best])
        if left.sum() < equal.sum():
            deciding.append(name)
        equal = left
    if not deciding:
        return []
    return [f"{n_equal} design points have the same {names[0]}; the best {', then '.join(deciding)} decides"]


def _feasible(rows: pd.DataFrame, limits: Sequence[Budget]) -> Bools:
    """Return which rows are within every limit, (row,)."""
    feasible = np.ones(len(rows), dtype=bool)
    for limit in limits:
        feasible &= limit.met(numbers(rows, limit.column))
    return feasible


def _nearest(rows: pd.DataFrame, limits: Sequence[Budget], ranking: Floats) -> pd.DataFrame:
    """Return the rows by how far they miss the limits, nearest first; one per trial and hardware profile."""
    missed = {limit: limit.excess(numbers(rows, limit.column)) for limit in limits}
    shortfall = np.zeros(len(rows))
    for limit, miss in missed.items():
        shortfall += miss / (abs(limit.limit) or 1.0)
    beside = {f"missed {limit}": miss for limit, miss in missed.items()} | {"shortfall": shortfall}
    table = pd.concat([rows, pd.DataFrame(beside, index=rows.index)], axis=1)  # one by one, pandas warns
    nearest = table.iloc[np.lexsort((*ranking[::-1], shortfall))]
    if "trial" not in nearest.columns:
        return nearest
    # Several points of one design would repeat it.
    return nearest.drop_duplicates([name for name in ("trial", "hardware") if name in nearest.columns])


def sure_pick(
    frame: pd.DataFrame,
    budgets: Sequence[str],
    maximise: str,
    tie_breaks: Sequence[tuple[str, str]],
    draws: Draws,
    confidence: float,
    by: str | Sequence[str] | None = None,
    n_nearest: int = 5,
    oversize: bool = False,
) -> Pick:
    """Return the pick among the rows that meet the conditions in a fraction `confidence` of the samples.

    In that fraction of the samples a row must be within all budgets at once, and on the front of `maximise`
    and the other objectives. Its numbers are those of the table, with the columns `front_share`, the fraction
    of samples in which it is on the front, and `confidence`, that in which it is within all budgets too.

    Args:
        frame: design points.
        budgets: as in `pick`.
        maximise: column to maximise.
        tie_breaks: (column, 'max' or 'min') pairs, the other goals of the front.
        draws: as in `front_share`, also for columns with a budget.
        confidence: the fraction, in (0, 1].
        by: columns whose values have separate fronts.
        n_nearest: as in `pick`.
        oversize: as in `pick`.

    Raises:
        ExpressionError: as in `pick`.
    """
    limits, conditions = split_budgets(budgets)
    goals = [(maximise, "max"), *tie_breaks]
    among = comparable(frame, goals, conditions, by, named_columns(budgets), oversize)
    if among.rows.empty:
        return Pick(
            None, pick(frame, budgets, maximise, tie_breaks, n_nearest, oversize).nearest, among.notes
        )
    drawn = front_draws(among.rows, goals, draws, by)
    if not drawn.values and drawn.rows.size and any(limit.column in draws.columns for limit in limits):
        values = draws.of(among.rows.iloc[drawn.rows])
        n_draws = len(next(iter(values.values())))
        drawn = Drawn(drawn.rows, np.repeat(drawn.on_front, n_draws, axis=0), values)
    within = _within(drawn, among.rows.iloc[drawn.rows], limits)
    share, joint = np.zeros(len(among.rows)), np.zeros(len(among.rows))
    if drawn.rows.size:
        share[drawn.rows] = drawn.on_front.mean(axis=0)
        joint[drawn.rows] = (drawn.on_front & within).mean(axis=0)
    rows = among.rows.assign(front_share=share, confidence=joint)
    on_front, sure = share >= confidence, joint >= confidence
    chosen = sure if sure.any() else on_front
    bounds = _bounds(drawn, chosen, limits, confidence)
    bounded = pick(rows[chosen].assign(**bounds), budgets, maximise, tie_breaks, n_nearest, oversize)
    notes = [*among.notes, *bounded.notes]
    # Columns are those of the table; misses are those of the bounds.
    if sure.any():
        row = None if bounded.row is None else rows.iloc[rows.index.tolist().index(bounded.row.name)]
        nearest = bounded.nearest
    else:
        row = None
        nearest = bounded.nearest
        if not on_front.any():
            surest = f"; the most certain one is in {share.max():.0%}" if len(share) else ""
            notes.insert(0, f"no design is non-dominated in {confidence:.0%} of the samples{surest}")
        elif bounded.row is not None:
            nearest = rows[on_front].sort_values("confidence", ascending=False, kind="stable").head(n_nearest)
            most = nearest["confidence"].iloc[0]
            notes.insert(0, f"no design meets all budgets at once in more than {most:.0%} of the samples")
    return Pick(row, nearest.assign(**{name: rows[name].reindex(nearest.index) for name in bounds}), notes)


def _within(drawn: Drawn, rows: pd.DataFrame, limits: Sequence[Budget]) -> Bools:
    """Return in which samples each row is within all limits at once, (draw, row)."""
    within = np.ones(drawn.on_front.shape, dtype=bool)
    for limit in limits:
        values = drawn.values.get(limit.column)
        within &= limit.met(numbers(rows, limit.column) if values is None else values)
    return within


def _bounds(drawn: Drawn, among: Bools, limits: Sequence[Budget], confidence: float) -> dict[str, Floats]:
    """Return the bounds that a fraction of the samples of limited columns keep, (row,), of some rows."""
    chosen = among[drawn.rows]
    bounds = {}
    for limit in limits:
        if limit.column in drawn.values and limit.direction and chosen.any():
            values = drawn.values[limit.column][:, chosen]
            better = np.sort(values, axis=0)[:: 1 if limit.direction == "min" else -1]
            bounds[limit.column] = better[int(np.ceil(confidence * len(better) - 1e-9)) - 1]
    return bounds


def budgeted(budgets: Sequence[str]) -> list[str]:
    """Return the columns that budgets limit.

    Raises:
        ExpressionError: a budget that cannot be read.
    """
    return [limit.column for limit in split_budgets(budgets)[0]]
