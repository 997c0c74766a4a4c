"""Two tables of design points side by side: their joint front, hypervolumes, and gains within budgets."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from dse.records import Floats
from dse.skyline.front import comparable
from dse.skyline.pareto import hypervolume, non_dominated_by_group
from dse.skyline.table import Goal, checked_goals, costs_of, group_numbers, numbers

STUDY = "study"
"""Column with the name of the table that a row is from."""

_SHARES = (0.1, 0.25, 0.5, 0.75, 1.0)  # of the joint front's designs that a budget admits


@dataclass(frozen=True)
class Comparison:
    """Two tables side by side; what is compared has one task and one hardware.

    summary: per table, task and hardware: points, trials, on_front (of its own), on_joint_front, hypervolume
        (of its own front) and hypervolume_joint, in [0, 1]: 1 is a design that is best in everything, over
        the ranges of both tables.
    front: rows of the joint front, with column `study`.
    gains: the largest value of what is maximised within budgets on each cost, per table, the gain of the
        second over the first, and its standard error where both are known.
    notes: on what was left out.
    """

    summary: pd.DataFrame
    front: pd.DataFrame
    gains: pd.DataFrame
    notes: list[str]


def compare(
    tables: Mapping[str, pd.DataFrame],
    goals: Sequence[tuple[str, str]],
    where: str | Sequence[str] | None = None,
) -> Comparison:
    """Compare two tables that have every objective, and tasks and hardware in common.

    Args:
        tables: name -> design points, two of them.
        goals: (column, 'max' or 'min') pairs.
        where: condition, or several, for the rows of both.

    Raises:
        ExpressionError: an unknown column or direction, or a condition that cannot be read.
    """
    checked = checked_goals(goals)
    # A copy is in one piece: pandas warns where a column is added to many.
    named = [table.copy().assign(**{STUDY: name}) for name, table in tables.items()]
    both = pd.concat(named, ignore_index=True)
    by = [name for name in ("task", "hardware") if name in both]
    rows, notes = comparable(both, checked, where, by)
    costs = costs_of(rows, checked)
    group = group_numbers(rows, by)
    from_table = group_numbers(rows, [STUDY, *by])
    joint = non_dominated_by_group(costs, group)
    single = non_dominated_by_group(costs, from_table)
    summary, gains = [], []
    for number in range(int(group.max(initial=-1)) + 1):
        here = group == number
        about = {name: rows.loc[here, name].iloc[0] for name in by}
        unit = _unit(costs[here])
        for name in tables:
            own = (rows[STUDY] == name).to_numpy()[here]
            of_name = rows[here][own]
            summary.append(
                {STUDY: name, **about, "points": len(of_name)}
                | ({"trials": of_name["trial"].nunique()} if "trial" in of_name else {})
                | {
                    "on_front": int(single[here][own].sum()),
                    "on_joint_front": int(joint[here][own].sum()),
                    "hypervolume": _volume(unit[single[here] & own]),
                    "hypervolume_joint": _volume(unit[joint[here]]),
                }
            )
        gains += _gains(rows[here], joint[here], list(tables), checked, about)
    order = np.lexsort((*costs[joint].T[::-1], group[joint]))
    return Comparison(pd.DataFrame(summary), rows[joint].iloc[order], pd.DataFrame(gains), notes)


def _unit(costs: Floats) -> Floats:
    """Return costs that vary over [0, 1]; one column of zeros where none varies."""
    low, high = costs.min(axis=0), costs.max(axis=0)
    varied = high > low
    return (
        (costs[:, varied] - low[varied]) / (high - low)[varied] if varied.any() else np.zeros((len(costs), 1))
    )


def _volume(unit: Floats) -> float:
    return hypervolume(unit, np.ones(unit.shape[1])) if len(unit) else 0.0


def _gains(
    rows: pd.DataFrame,
    joint: np.ndarray,
    names: Sequence[str],
    goals: Sequence[Goal],
    about: Mapping[str, object],
) -> list[dict[str, object]]:
    """Return the best of each table within budgets on each cost, at which shares of the joint front lie."""
    gain = next((goal for goal in goals if goal.direction == "max"), None)
    if gain is None:
        return []
    error = f"{gain.column}_se"
    lines: list[dict[str, object]] = []
    for goal in goals:
        if goal.direction != "min":
            continue
        cost = numbers(rows, goal.column)
        levels = np.quantile(cost[joint], _SHARES, method="higher")
        for level in np.unique([_rounded_up(float(x)) for x in levels]):
            best = [_best(rows[(cost <= level) & (rows[STUDY] == name)], gain.column) for name in names]
            line = {**about, "budget": f"{goal.column} <= {np.format_float_positional(level, trim='-')}"}
            line |= {f"{gain.column} {name}": row[gain.column] for name, row in zip(names, best, strict=True)}
            first, second = best
            line["gain"] = second[gain.column] - first[gain.column]
            if error in rows:
                line["gain_se"] = float(np.hypot(first[error], second[error]))
            lines.append(line)
    return lines


def _rounded_up(level: float) -> float:
    """Return a level with four significant digits that admits it."""
    if level == 0:
        return 0.0
    unit = 10.0 ** (math.floor(math.log10(abs(level))) - 3)
    return float(f"{math.ceil(round(level / unit, 6)) * unit:.10g}")


def _best(rows: pd.DataFrame, column: str) -> pd.Series:
    """Return the row with the largest value; a row of NaN where there is none."""
    if rows.empty:
        return pd.Series(np.nan, rows.columns)
    return rows.iloc[int(rows[column].fillna(-np.inf).to_numpy().argmax())]
