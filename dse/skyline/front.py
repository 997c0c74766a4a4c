"""The front of a table of design points, under constraints.

A table is a pandas DataFrame with one row per design point; columns are named as in the record of
a trial. Goals are (column, 'max' or 'min') pairs. A row with a NaN or infinite goal is left out, and the
notes state the number and the reason. A row that is not admissible (`dse.skyline.admissible`) is left out
too, unless the condition names the column `fits` or `transductive`.
"""

from __future__ import annotations

import html
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from dse.base.records import Bools, Floats, Ints
from dse.skyline.admissible import candidates, leave_out_unmeasured, meeting
from dse.skyline.constraints import column, named_columns, split_budgets
from dse.skyline.pareto import members_of, non_dominated, non_dominated_by_group
from dse.skyline.table import Goal, checked_goals, costs_of, group_numbers, numbers


class Skyline(NamedTuple):
    """The non-dominated rows, and notes on what was left out."""

    rows: pd.DataFrame
    notes: list[str]

    def _repr_html_(self) -> str:
        """Return the rows and the notes, for notebooks."""
        notes = "".join(f"<p>{html.escape(note)}</p>" for note in self.notes)
        return self.rows.to_html(index=False, border=0, na_rep="-", max_rows=20, max_cols=16) + notes


class Draws(NamedTuple):
    """A sampler of columns that depend on uncertain numbers.

    columns: their names; `<column>_low` and `<column>_high` of the table are the ends of every sample.
    of: rows -> column -> (draw, row).
    ends: rows -> column -> least and largest value in any sample, (row,) each, of columns whose ends are not
        in the table.
    """

    columns: Sequence[str]
    of: Callable[[pd.DataFrame], Mapping[str, Floats]]
    ends: Callable[[pd.DataFrame], Mapping[str, tuple[Floats, Floats]]] = lambda rows: {}


class Drawn(NamedTuple):
    """Samples of the rows that may be on a front.

    rows: (k,) their positions in the table.
    on_front: (draw, k) whether each is non-dominated in a sample.
    values: column -> (draw, k).
    """

    rows: Ints
    on_front: Bools
    values: Mapping[str, Floats]


def skyline(
    frame: pd.DataFrame,
    goals: Sequence[tuple[str, str]],
    where: str | Sequence[str] | None = None,
    by: str | Sequence[str] | None = None,
    oversize: bool = False,
) -> Skyline:
    """Return the rows that meet a condition and that no other such row dominates.

    Neither costs on different hardware nor accuracies of different tasks compare: each hardware and task has
    a separate front. Rows with equal goals do not dominate each other: all of them are returned. Rows are
    sorted by hardware, task and further groups, then by goals, best first; the index is that of the table.

    Args:
        frame: design points.
        goals: (column, 'max' or 'min') pairs.
        where: condition in the language of `dse.skyline.constraints`, or several.
        by: further columns whose values are compared among themselves only, such as family.
        oversize: admit rows that do not fit their hardware.

    Raises:
        ExpressionError: an unknown column or direction, or a condition that cannot be read.
    """
    rows, notes = comparable(frame, goals, where, by, oversize=oversize)
    costs = costs_of(rows, checked_goals(goals))
    columns = front_columns(rows, by)
    on_front = non_dominated_by_group(costs, group_numbers(rows, columns))
    groups = [group_numbers(rows, [name])[on_front] for name in reversed(columns)]
    return Skyline(rows[on_front].iloc[np.lexsort((*costs[on_front].T[::-1], *groups))], notes)


def comparable(
    frame: pd.DataFrame,
    goals: Sequence[tuple[str, str]],
    where: str | Sequence[str] | None = None,
    by: str | Sequence[str] | None = None,
    named: Iterable[str] = (),
    oversize: bool = False,
) -> Skyline:
    """Return the candidates of a front: the rows that meet a condition and have every goal.

    Whether rows fit their hardware does not depend on the limits that the condition sets. If no goal
    depends on hardware and the table holds the same points on several, only the first is used.

    Args:
        frame: design points.
        goals: (column, 'max' or 'min') pairs.
        where: condition in the language of `dse.skyline.constraints`, or several, all of which must be met.
        by: as in `skyline`.
        named: columns that further conditions of the caller name, such as budgets.
        oversize: as in `skyline`.

    Raises:
        ExpressionError: as in `skyline`.
    """
    names = [goal.column for goal in checked_goals(goals)]
    conditions = as_list(where or None)
    named = {*named, *named_columns(conditions)}
    depends = {*names, *as_list(by)}
    rest = split_budgets(conditions)[1]
    rows, notes = candidates(frame, rest, named, oversize, depends)
    rows, unmeasured = leave_out_unmeasured(rows[meeting(rows, conditions)], names)
    return Skyline(rows, notes + unmeasured)


def front_mask(
    frame: pd.DataFrame,
    goals: Iterable[tuple[str, str]],
    group: Ints | None = None,
    among: Bools | None = None,
) -> Bools:
    """Return which rows no other row of their group dominates, (row,).

    A row without a finite value of every goal, or not `among`, is on no front and dominates nothing. Values
    that are no numbers count as missing.

    Args:
        frame: design points, admissible or not.
        goals: (column, 'max' or 'min') pairs.
        group: (row,) group numbers, as in `group_numbers`; None: one group.
        among: (row,) which rows to compare, such as `admissible(frame)`; None: all.

    Raises:
        ExpressionError: an unknown column or direction.
    """
    checked = checked_goals(goals)
    values = [pd.to_numeric(column(frame, goal.column), errors="coerce") for goal in checked]
    costs = np.column_stack(
        [goal.sign * np.asarray(x, np.float64) for goal, x in zip(checked, values, strict=True)]
    )
    compared = np.isfinite(costs).all(axis=1)
    if among is not None:
        compared &= among
    groups = np.zeros(len(frame), np.int64) if group is None else group
    mask = np.zeros(len(frame), dtype=bool)
    mask[compared] = non_dominated_by_group(costs[compared], groups[compared])
    return mask


def front_share(
    frame: pd.DataFrame,
    goals: Sequence[tuple[str, str]],
    draws: Draws,
    by: str | Sequence[str] | None = None,
) -> Floats:
    """Return the fraction of samples in which each row is non-dominated among all rows, (row,).

    Args:
        frame: rows of `comparable`.
        goals: (column, 'max' or 'min') pairs.
        draws: of what is uncertain; other columns are as they stand. A row with NaN in a draw is not on that
            draw's front. Sampled only for rows whose ranges leave them a chance.
        by: as in `skyline`.
    """
    share = np.zeros(len(frame))
    drawn = front_draws(frame, goals, draws, by)
    if drawn.rows.size:
        share[drawn.rows] = drawn.on_front.mean(axis=0)
    return share


def front_draws(
    frame: pd.DataFrame,
    goals: Sequence[tuple[str, str]],
    draws: Draws,
    by: str | Sequence[str] | None = None,
) -> Drawn:
    """Return in which samples each row that may be on the front is on it; arguments as of `front_share`."""
    checked = checked_goals(goals)
    costs = costs_of(frame, checked)
    group = group_numbers(frame, front_columns(frame, by))
    uncertain = {place: goal for place, goal in enumerate(checked) if goal.column in draws.columns}
    if not uncertain:
        return Drawn(np.arange(len(frame)), non_dominated_by_group(costs, group)[None], {})
    known = draws.ends(frame)
    ends = {place: _range(frame, goal, known) for place, goal in uncertain.items()}
    possible = _possible(costs, ends, group)
    if not len(possible):
        return Drawn(possible, np.zeros((1, 0), dtype=bool), {})
    drawn = draws.of(frame.iloc[possible])
    values = {place: goal.sign * drawn[goal.column] for place, goal in uncertain.items()}
    costs, group = costs[possible], group[possible]
    # The draws themselves leave fewer rows a chance than the ends of all ranges do.
    ranges = {place: (np.min(x, axis=0), np.max(x, axis=0)) for place, x in values.items()}
    left = _possible(costs, ranges, group)
    costs, group, values = costs[left], group[left], {place: x[:, left] for place, x in values.items()}
    n_draws = len(next(iter(values.values())))
    on_front = np.zeros((n_draws, len(left)), dtype=bool)
    for draw in range(n_draws):
        for place, x in values.items():
            costs[:, place] = x[draw]
        here = np.isfinite(costs).all(axis=1)
        on_front[draw, here] = non_dominated_by_group(costs[here], group[here])
    return Drawn(possible[left], on_front, {name: x[:, left] for name, x in drawn.items()})


_ROUNDING = 1e-9  # of a range's ends, relative: draws at an end are computed in another order


def _range(
    frame: pd.DataFrame, goal: Goal, known: Mapping[str, tuple[Floats, Floats]]
) -> tuple[Floats, Floats]:
    """Return the least and the largest cost of each row in any sample; without a range, infinities."""
    if goal.column in known:
        low, high = np.sort([goal.sign * x for x in known[goal.column]], axis=0)
        return low, high
    if not {f"{goal.column}_low", f"{goal.column}_high"} <= set(frame):
        return np.full(len(frame), -np.inf), np.full(len(frame), np.inf)
    ends = np.sort([goal.sign * numbers(frame, f"{goal.column}_{end}") for end in ("low", "high")], axis=0)
    return ends[0] - _ROUNDING * abs(ends[0]), ends[1] + _ROUNDING * abs(ends[1])


def _possible(costs: Floats, ranges: Mapping[int, tuple[Floats, Floats]], group: Ints) -> Ints:
    """Return the rows that may be on the front for some costs in their ranges (least, most).

    A row whose least cost is dominated by another's largest is never on it.
    """
    least, most = costs.copy(), costs.copy()
    for place, (low, high) in ranges.items():
        unknown = np.isnan(low) | np.isnan(high)
        least[:, place] = np.where(unknown, -np.inf, low)
        most[:, place] = np.where(unknown, np.inf, high)
    remaining = []
    for members in members_of(group):
        for dearest in most[members][non_dominated(most[members])]:
            cheapest = least[members]
            beaten = (dearest <= cheapest).all(axis=1) & (dearest < cheapest).any(axis=1)
            members = members[~beaten]
        remaining.append(members)
    return np.sort(np.concatenate(remaining)) if remaining else np.zeros(0, np.int64)


def front_columns(rows: pd.DataFrame, by: str | Sequence[str] | None) -> list[str]:
    """Return the columns whose values have separate fronts: hardware and task if there are several; `by`."""
    several = [name for name in ("hardware", "task") if name in rows and rows[name].nunique() > 1]
    return list(dict.fromkeys([*several, *as_list(by)]))


def as_list(by: str | Sequence[str] | None) -> list[str]:
    """Return columns, given as one name, several or None, as a list."""
    return [by] if isinstance(by, str) else list(by or [])
