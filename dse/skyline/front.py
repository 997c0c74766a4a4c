"""Tables of design points: the skyline under constraints, and the pick within budgets.

A table is a pandas DataFrame with one row per design point; columns are named as in the record of
a trial. Objectives are (column, 'max' or 'min') pairs. Rows whose objective is NaN or infinite
cannot be compared: they are left out, and the notes say how many and which. So are transductive rows,
unless a condition names that column.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from dse.config.sections import OF_HARDWARE
from dse.skyline.constraints import ExpressionError, column, matches, split_budgets
from dse.skyline.pareto import non_dominated

Objective = tuple[str, str]

_NAMED = 5  # rows that a note names before it says how many more there are


class TableError(ValueError):
    """A file that is no table of points."""


class Skyline(NamedTuple):
    """The non-dominated rows, and what was left out."""

    rows: pd.DataFrame
    notes: list[str]


class Pick(NamedTuple):
    """The best row within the budgets, or the rows that come nearest.

    row: None where no row meets every budget.
    nearest: only then: rows ranked by `shortfall`, the sum over the budgets of miss / |limit|
        (miss itself where the limit is 0); one column `missed <budget>` each, in the budget's unit.
        A strict limit that is hit exactly is missed by 0.
    notes: what could not be compared.
    """

    row: pd.Series[Any] | None
    nearest: pd.DataFrame
    notes: list[str]


class Draws(NamedTuple):
    """What some columns of a table are under draws of what they depend on.

    columns: which; of those, `<column>_low` and `<column>_high` are the ends of what a draw may give.
    of: rows -> column -> (draw, row).
    """

    columns: Sequence[str]
    of: Callable[[pd.DataFrame], Mapping[str, NDArray[np.float64]]]


def read(path: str | Path) -> pd.DataFrame:
    """Read a table of points: CSV, Parquet, JSON (rows, or a `dse` document), or a study's folder.

    Raises:
        TableError: no such file, another kind of file, a damaged or an empty one.
    """
    file = Path(path)
    if file.is_dir():
        file = file / "points.parquet"
    if not file.is_file():
        raise TableError(f"{file}: no such file")
    try:
        frame = _read(file)
    except TableError:
        raise
    except Exception as error:  # each reader has its own kinds; what users need is the file and the reason
        raise TableError(f"{file}: no readable table: {str(error).strip().splitlines()[0]}") from error
    if frame.empty:
        raise TableError(f"{file}: the table has no rows")
    return frame


def _read(file: Path) -> pd.DataFrame:
    kind = file.suffix.lower()
    if kind == ".csv":
        return pd.read_csv(file)
    if kind in (".parquet", ".pq"):
        return pd.read_parquet(file)
    if kind == ".json":
        content = json.loads(file.read_text(encoding="utf-8"))
        if isinstance(content, dict) and "rows" not in content:
            raise TableError(f"{file}: must hold a list of rows, or an object with 'rows'")
        return pd.DataFrame(content["rows"] if isinstance(content, dict) else content)
    raise TableError(f"{file}: must be .csv, .parquet, .json or the folder of a study")


def parse_objectives(text: str) -> list[Objective]:
    """Return the objectives that "accuracy:max,energy_uj:min" names.

    Raises:
        ExpressionError: a direction is missing or unknown, or a column is named twice.
    """
    objectives = []
    for part in text.split(","):
        name, _, direction = (x.strip() for x in part.partition(":"))
        objectives.append((name, direction))
    _check(objectives)
    return objectives


def skyline(
    frame: pd.DataFrame,
    objectives: Sequence[Objective],
    where: str | None = None,
    by: str | Sequence[str] | None = None,
) -> Skyline:
    """Return the rows that meet a condition and that no other such row dominates.

    Costs on different hardware do not compare: each has a front of its own. Rows with equal objectives do
    not dominate each other: all of them are kept, one after the other. Rows come group by group, best first
    objective first; the index says where they stood in the table.

    Args:
        frame: design points.
        objectives: (column, 'max' or 'min') pairs.
        where: condition in the language of `dse.skyline.constraints`.
        by: columns whose values are compared among themselves only (a front per task, or task and chip).

    Raises:
        ExpressionError: an unknown column or direction, or a condition that cannot be read.
    """
    rows, notes = comparable(frame, objectives, where, by)
    costs = _costs(rows, objectives)
    group = _groups(rows, _apart(rows, by))
    on_front = _on_front(costs, group)
    order = np.lexsort((*costs[on_front].T[::-1], group[on_front]))
    return Skyline(rows[on_front].iloc[order], notes)


def comparable(
    frame: pd.DataFrame,
    objectives: Sequence[Objective],
    where: str | None = None,
    by: str | Sequence[str] | None = None,
) -> Skyline:
    """Return the rows that a front is sought among: those that meet a condition and have every objective.

    Rows that do not fit their hardware are left out where others do, whatever limits the condition sets,
    unless it names `fits`. Where no objective depends on hardware and the table holds the same points on
    several, the first serves.

    Args:
        frame: design points.
        objectives: (column, 'max' or 'min') pairs.
        where: condition in the language of `dse.skyline.constraints`.
        by: as of `skyline`.

    Raises:
        ExpressionError: as of `skyline`.
    """
    _check(objectives)
    rows = frame
    for condition in split_budgets([where])[1] if where else ():
        rows = rows[matches(condition, rows)]
    names = [name for name, _ in objectives]
    rows, once = _once(rows, [*names, *([by] if isinstance(by, str) else by or [])], where or "")
    rows, leaky = _honest(rows, where or "")
    rows, misfits = _fitting(rows, where or "")
    if where:  # as of a pick, what fits does not depend on limits
        rows = rows[matches(where, rows)]
    rows, notes = _comparable(rows, names)
    return Skyline(rows, once + leaky + misfits + notes)


def front_share(
    frame: pd.DataFrame,
    objectives: Sequence[Objective],
    draws: Draws,
    by: str | Sequence[str] | None = None,
) -> NDArray[np.float64]:
    """Return in what share of draws each row is non-dominated among all of them, (row,).

    Args:
        frame: rows of `comparable`.
        objectives: (column, 'max' or 'min') pairs.
        draws: of what is uncertain; other columns are as they stand. A row with NaN in a draw is not on that
            draw's front. Asked only for rows whose ranges leave them a chance.
        by: as of `skyline`.
    """
    _check(objectives)
    costs = _costs(frame, objectives)
    group = _groups(frame, _apart(frame, by))
    places = {
        place: (name, 1.0 if direction == "min" else -1.0)
        for place, (name, direction) in enumerate(objectives)
        if name in draws.columns
    }
    if not places:
        return _on_front(costs, group).astype(np.float64)
    share = np.zeros(len(frame))
    possible = _possible(costs, {place: _range(frame, *of) for place, of in places.items()}, group)
    if not len(possible):
        return share
    drawn = draws.of(frame.iloc[possible])
    values = {place: sign * drawn[name] for place, (name, sign) in places.items()}
    costs, group = costs[possible], group[possible]
    # What the draws themselves leave a chance is less again than what the ends of all figures do.
    ranges = {place: (np.min(x, axis=0), np.max(x, axis=0)) for place, x in values.items()}
    left = _possible(costs, ranges, group)
    costs, group, values = costs[left], group[left], {place: x[:, left] for place, x in values.items()}
    n_draws = len(next(iter(values.values())))
    times = np.zeros(len(costs))
    for draw in range(n_draws):
        for place, x in values.items():
            costs[:, place] = x[draw]
        here = np.isfinite(costs).all(axis=1)
        times[here] += _on_front(costs[here], group[here])
    share[possible[left]] = times / n_draws
    return share


_ROUNDING = 1e-9  # of a range's ends, relative: draws at an end are computed in another order


def _range(frame: pd.DataFrame, name: str, sign: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the least and the largest cost that a draw may give each row; without a range, anything."""
    if not {f"{name}_low", f"{name}_high"} <= set(frame):
        return np.full(len(frame), -np.inf), np.full(len(frame), np.inf)
    ends = np.sort([sign * _numbers(frame, f"{name}_{end}") for end in ("low", "high")], axis=0)
    return ends[0] - _ROUNDING * abs(ends[0]), ends[1] + _ROUNDING * abs(ends[1])


def _possible(
    costs: NDArray[np.float64],
    ranges: Mapping[int, tuple[NDArray[np.float64], NDArray[np.float64]]],
    group: NDArray[np.int64],
) -> NDArray[np.int64]:
    """Return the rows that may be on the front, wherever in their ranges (least, most) the costs are.

    A row whose least cost is dominated by another's largest is never on it.
    """
    least, most = costs.copy(), costs.copy()
    for place, (low, high) in ranges.items():
        silent = np.isnan(low) | np.isnan(high)
        least[:, place] = np.where(silent, -np.inf, low)
        most[:, place] = np.where(silent, np.inf, high)
    found = []
    for members in (np.flatnonzero(group == g) for g in range(group.max(initial=-1) + 1)):
        for one in most[members][non_dominated(most[members])]:
            own = least[members]
            members = members[~((one <= own).all(axis=1) & (one < own).any(axis=1))]
        found.append(members)
    return np.sort(np.concatenate(found)) if found else np.zeros(0, np.int64)


def _groups(rows: pd.DataFrame, by: str | Sequence[str] | None) -> NDArray[np.int64]:
    """Return the number of each row's group, in the order of the table."""
    names = [by] if isinstance(by, str) else list(by or [])
    if not names:
        return np.zeros(len(rows), np.int64)
    columns = [column(rows, name) for name in names]
    keys = list(zip(*columns, strict=True)) if len(columns) > 1 else columns[0]
    return np.asarray(pd.factorize(pd.Series(keys, dtype=object), use_na_sentinel=False)[0], np.int64)


def _on_front(costs: NDArray[np.float64], group: NDArray[np.int64]) -> NDArray[np.bool_]:
    found = np.zeros(len(costs), dtype=bool)
    for members in (np.flatnonzero(group == g) for g in range(group.max(initial=-1) + 1)):
        found[members] = non_dominated(costs[members])
    return found


def front_ends(
    frame: pd.DataFrame,
    by: str | None = None,
    design: Sequence[str] = (),
    accuracy: str = "accuracy",
    spikes: str = "spikes_per_inference",
    weights: str = "n_weights",
) -> Skyline:
    """Return the ends of the front of accuracy, spikes S and weights W_t: best accuracy, least S, least W_t.

    Ties go to the better accuracy, then to the smaller S, then to the smaller W_t, then to the first row. An
    end by this rule is on the front itself.

    Source: Brayshaw et al., texture and velocity, Table 3 (REFERENCES.md).

    Args:
        frame: design points.
        by: column with a front for each of its values (a task).
        design: columns that say what the design was.
        accuracy: column to maximise.
        spikes: column of S.
        weights: column of W_t.

    Returns:
        Three rows per front in the order of the table's values of `by`: `by`, `end`, accuracy, S, W_t and the
        design; the index says where they stood in the table.

    Raises:
        ExpressionError: an unknown column, or one that holds no numbers.
    """
    for name in (*design, *([] if by is None else [by])):
        column(frame, name)
    rows, leaky = _honest(frame, "")
    rows, notes = _comparable(rows, [accuracy, spikes, weights])
    costs = _costs(rows, [(accuracy, "max"), (spikes, "min"), (weights, "min")])
    group = _groups(rows, by)
    found, ends = [], []
    for members in (np.flatnonzero(group == g) for g in range(group.max(initial=-1) + 1)):
        own = costs[members].T
        for number, end in enumerate(("best accuracy", "least spikes", "least weights")):
            found.append(members[np.lexsort((*own[::-1], own[number]))[0]])
            ends.append(end)
    names = dict.fromkeys([*([] if by is None else [by]), "end", accuracy, spikes, weights, *design])
    return Skyline(rows.iloc[found].assign(end=ends)[list(names)], leaky + notes)


def pick(
    frame: pd.DataFrame,
    budgets: Sequence[str],
    maximise: str = "accuracy",
    tie_breaks: Sequence[Objective] = (),
    n_nearest: int = 5,
) -> Pick:
    """Return the best row within the budgets; where there is none, the nearest rows.

    Ties of `maximise` go to `tie_breaks` in their order, then to the row that uses least of the
    budgets in their order, then to the first row of the table. A row without the number of a tie break, such
    as the energy of a classifier that a chip cannot run, comes last there.

    Args:
        frame: design points.
        budgets: conditions such as "energy_uj <= 50 and n_weights <= 150000". Comparisons of a column
            with a number are budgets; anything else (task == 'texture') is a condition never relaxed.
        maximise: column to maximise.
        tie_breaks: (column, 'max' or 'min') pairs.
        n_nearest: how many rows to name where no row is within the budgets; of several points of a trial
            on one hardware profile, the nearest.

    Raises:
        ExpressionError: an unknown column, or a budget that cannot be read.
    """
    limits, conditions = split_budgets(budgets)
    used = [(limit.column, limit.direction) for limit in limits if limit.direction]
    order = list(dict.fromkeys([(maximise, "max"), *tie_breaks, *used]))
    _check([(maximise, "max"), *tie_breaks])
    rows = frame
    for condition in conditions:
        rows = rows[matches(condition, rows)]
    rows, leaky = _honest(rows, " ".join([*conditions, *(limit.column for limit in limits)]))
    rows, misfits = _fitting(rows, " ".join([*conditions, *(limit.column for limit in limits)]))
    empty = [f"no row meets {' and '.join(conditions)}"] if conditions and rows.empty else []
    rows, notes = _comparable(rows, list(dict.fromkeys([maximise, *(limit.column for limit in limits)])))
    notes = leaky + misfits + empty + notes
    costs = _costs(rows, order)
    ranking = np.where(np.isfinite(costs), costs, np.inf).T[::-1]
    values = [_numbers(rows, limit.column) for limit in limits]
    feasible = np.ones(len(rows), dtype=bool)
    for limit, used_up in zip(limits, values, strict=True):
        feasible &= limit.met(used_up)
    if feasible.any():
        best = np.lexsort((*ranking, ~feasible))[0]
        return Pick(rows.iloc[int(best)], rows.iloc[:0], notes)
    missed = {limit: limit.excess(used_up) for limit, used_up in zip(limits, values, strict=True)}
    shortfall = np.zeros(len(rows))
    for limit, miss in missed.items():
        shortfall += miss / (abs(limit.limit) or 1.0)
    table = rows.assign(**{f"missed {limit}": miss for limit, miss in missed.items()}, shortfall=shortfall)
    nearest = table.iloc[np.lexsort((*ranking, shortfall))]
    if "trial" in nearest.columns:  # five settings of one design would say little
        nearest = nearest.drop_duplicates([name for name in ("trial", "hardware") if name in nearest.columns])
    return Pick(None, nearest.iloc[:n_nearest], notes)


def budgeted(budgets: Sequence[str]) -> list[str]:
    """Return the columns that budgets limit.

    Raises:
        ExpressionError: a budget that cannot be read.
    """
    return [limit.column for limit in split_budgets(budgets)[0]]


def sure_pick(
    frame: pd.DataFrame,
    budgets: Sequence[str],
    maximise: str,
    tie_breaks: Sequence[Objective],
    draws: Draws,
    confidence: float,
    by: str | Sequence[str] | None = None,
    n_nearest: int = 5,
) -> Pick:
    """Return `pick` among the rows that are surely good, whatever the hardware's figures turn out to be.

    A row must be within each budget in a share of the draws, and on the front of `maximise` and the tie
    breaks in as many of them. Its numbers are reported as they stand, with `front_share` beside.

    Args:
        frame: design points.
        budgets: as of `pick`.
        maximise: column to maximise.
        tie_breaks: (column, 'max' or 'min') pairs, the other objectives of the front.
        draws: as of `front_share`, of what budgets limit too.
        confidence: the share, in (0, 1].
        by: columns whose values have fronts of their own.
        n_nearest: as of `pick`.

    Raises:
        ExpressionError: as of `pick`.
    """
    limits, conditions = split_budgets(budgets)
    objectives = [(maximise, "max"), *tie_breaks]
    among = comparable(frame, objectives, " and ".join(f"({c})" for c in conditions) or None, by)
    share = front_share(among.rows, objectives, draws, by)
    sure = share >= confidence
    rows = among.rows.assign(front_share=share)[sure]
    costs = draws.of(rows) if sure.any() else {}
    bounds = {}
    for limit in limits:
        if limit.column in costs and limit.direction:
            # The value that so many draws stay within: the k-th best of them.
            better = np.sort(costs[limit.column], axis=0)[:: 1 if limit.direction == "min" else -1]
            bounds[limit.column] = better[int(np.ceil(confidence * len(better) - 1e-9)) - 1]
    found = pick(rows.assign(**bounds), budgets, maximise, tie_breaks, n_nearest)
    notes = [*among.notes, *found.notes]
    if not sure.any():
        surest = f"; the surest is in {share.max():.0%}" if len(share) else ""
        notes.insert(0, f"no design is non-dominated in {confidence:.0%} of the draws{surest}")
    # Numbers as they stand; what is missed is what was missed with confidence.
    nearest = found.nearest.assign(**{name: rows[name].reindex(found.nearest.index) for name in bounds})
    row = None if found.row is None else rows.iloc[rows.index.tolist().index(found.row.name)]
    return Pick(row, nearest, notes)


def _honest(rows: pd.DataFrame, condition: str) -> tuple[pd.DataFrame, list[str]]:
    """Leave out rows whose classifier saw the labels that it answers, unless the condition names them."""
    if "transductive" in condition:
        return rows, []
    keep = honest(rows)
    n = int((~keep).sum())
    if not n:
        return rows, []
    noun = "row" if n == 1 else "rows"
    return rows[keep], [f"{n} transductive {noun} left out: what answers has seen the labels"]


def honest(rows: pd.DataFrame) -> NDArray[np.bool_]:
    """Return which rows are of classifiers that have not seen the labels that they answer."""
    try:
        leaky = rows["transductive"].astype("boolean")
    except (KeyError, TypeError, ValueError):  # a column of that name that says something else
        return np.ones(len(rows), dtype=bool)
    return ~leaky.fillna(False).to_numpy(dtype=bool)


def admissible(rows: pd.DataFrame) -> NDArray[np.bool_]:
    """Return which rows a front compares: the honest ones that fit their hardware, where any does."""
    keep = honest(rows)
    of_hardware = [name for name in ("fits", "hardware") if name in rows.columns]
    keep[keep] = fitting(rows.loc[keep, of_hardware])
    return keep


def fitting(rows: pd.DataFrame) -> NDArray[np.bool_]:
    """Return which rows fit their hardware; all of a hardware that nothing fits, as if it went on."""
    fits = _fits(rows)
    chips = _chips(rows)
    return np.asarray(fits | ~np.isin(chips, chips[fits]))


def _fits(rows: pd.DataFrame) -> NDArray[np.bool_]:
    """Return which rows fit; one without an answer where others of its hardware have one cannot run there.

    A column `fits` that holds anything but yes, no or nothing is not about hardware.
    """
    try:
        fits = rows["fits"].astype("boolean")
    except (KeyError, TypeError, ValueError):
        return np.ones(len(rows), dtype=bool)
    chips = _chips(rows)
    answered = np.isin(chips, chips[fits.notna().to_numpy()])
    return np.where(fits.isna(), ~answered, fits.fillna(False).to_numpy(dtype=bool))


def _chips(rows: pd.DataFrame) -> NDArray[np.int64]:
    """Return the number of each row's hardware; all are on one where the table does not say."""
    return _groups(rows, "hardware" if "hardware" in rows else None)


def _fitting(rows: pd.DataFrame, condition: str) -> tuple[pd.DataFrame, list[str]]:
    """Leave out rows that do not fit their hardware, unless the condition names that or nothing fits it."""
    if "fits" not in rows.columns or re.search(r"\bfits\b", condition):
        return rows, []
    keep = fitting(rows)
    unnamed = pd.Series("the chip", rows.index, dtype=object)
    chips = rows["hardware"].astype(object).fillna(unnamed) if "hardware" in rows else unnamed
    notes = [
        f"{n} {'row' if n == 1 else 'rows'} left out: {'it does' if n == 1 else 'they do'} not fit {chip}"
        for chip, n in chips[~keep].value_counts(sort=False).items()
    ]
    notes += [
        f"no design fits {chip}: its costs are as if it went on"
        for chip in chips[keep & ~_fits(rows)].unique()
    ]
    return rows[keep], notes


def _once(rows: pd.DataFrame, names: Sequence[str], condition: str) -> tuple[pd.DataFrame, list[str]]:
    """Keep the points on one hardware where nothing that is asked depends on it."""
    asked = "hardware" in names or "hardware" in condition or any(name in OF_HARDWARE for name in names)
    if asked or "hardware" not in rows or rows["hardware"].isna().any() or rows["hardware"].nunique() < 2:
        return rows, []
    first = rows["hardware"].iloc[0]
    return rows[rows["hardware"] == first], [f"points on {first}: no objective depends on hardware"]


def _apart(rows: pd.DataFrame, by: str | Sequence[str] | None) -> list[str]:
    """Return the columns whose values have a front each: as asked, and hardware."""
    names = [by] if isinstance(by, str) else list(by or [])
    several = "hardware" in rows and rows["hardware"].nunique() > 1
    return [*names, *(["hardware"] if several and "hardware" not in names else [])]


def _check(objectives: Sequence[Objective]) -> None:
    if not objectives:
        raise ExpressionError("objectives must name at least one column, such as accuracy:max")
    for name, direction in objectives:
        if direction not in ("max", "min"):
            raise ExpressionError(f"objective '{name}' must be followed by :max or :min, got '{direction}'")
    names = [name for name, _ in objectives]
    twice = [name for name in dict.fromkeys(names) if names.count(name) > 1]
    if twice:
        raise ExpressionError(f"objective '{twice[0]}' is named twice")


def _numbers(frame: pd.DataFrame, name: str) -> NDArray[np.float64]:
    series = column(frame, name)
    try:
        return series.to_numpy(dtype=np.float64, na_value=np.nan)
    except (TypeError, ValueError):
        raise ExpressionError(f"column '{name}' must hold numbers to be an objective or a budget") from None


def _costs(frame: pd.DataFrame, objectives: Sequence[Objective]) -> NDArray[np.float64]:
    """Return (row, objective), all minimised."""
    signs = {"min": 1.0, "max": -1.0}
    return np.stack([signs[direction] * _numbers(frame, name) for name, direction in objectives], axis=1)


def _comparable(frame: pd.DataFrame, names: Sequence[str]) -> tuple[pd.DataFrame, list[str]]:
    """Leave out rows with NaN or infinity in the named columns; one note per column and kind."""
    keep = np.ones(len(frame), dtype=bool)
    notes = []
    for name in names:
        values = _numbers(frame, name)
        costs = name in OF_HARDWARE and "hardware" in frame
        for kind, wrong in (("NaN", np.isnan(values)), ("infinite", np.isinf(values))):
            if wrong.any():
                chips = " and ".join(dict.fromkeys(map(str, frame["hardware"][wrong]))) if costs else ""
                why = f" ({chips} cannot run them, or is known by intervals only)" if chips else ""
                notes.append(f"{_row_names(frame, wrong)} left out: {name} is {kind}{why}")
                keep &= ~wrong
    return frame[keep], notes


def _row_names(frame: pd.DataFrame, mask: NDArray[np.bool_]) -> str:
    noun, labels = ("trial", frame["trial"]) if "trial" in frame.columns else ("row", frame.index.to_series())
    names = list(dict.fromkeys(map(str, labels[mask])))
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    rows = "" if len(names) == mask.sum() else f" ({mask.sum()} rows)"
    return f"{noun}{'s' if len(names) > 1 else ''} {', '.join(names[:_NAMED])}{more}{rows}"
