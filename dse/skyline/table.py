"""Tables of design points: reading them, and their columns as numbers, groups and goals."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from dse import store
from dse.base.records import Floats, Ints
from dse.skyline.constraints import ExpressionError, column

_PARQUET = (".parquet", ".pq")


class TableError(ValueError):
    """A file that is no table of points."""


def read(path: str | Path) -> pd.DataFrame:
    """Read a table of points: CSV, Parquet, JSON (rows, or a `dse` document), or a study's folder.

    Raises:
        TableError: no such file, another kind of file, a damaged or an empty one.
        StoreError: a table that dse has written is no longer what was written.
    """
    file = Path(path)
    if file.is_dir():
        file = file / "points.parquet"
    if not file.is_file():
        raise TableError(f"{file}: no such file")
    if file.suffix.lower() in _PARQUET:
        store.verify(file)
    try:
        frame = _read(file)
    except TableError:
        raise
    except Exception as error:  # every reader raises other errors; users need the file and the reason
        raise TableError(f"{file}: the table cannot be read: {str(error).strip().splitlines()[0]}") from error
    if frame.empty:
        raise TableError(f"{file}: the table has no rows")
    return frame


def _read(file: Path) -> pd.DataFrame:
    kind = file.suffix.lower()
    if kind == ".csv":
        return pd.read_csv(file)
    if kind in _PARQUET:
        return pd.read_parquet(file)
    if kind == ".json":
        content = json.loads(file.read_text(encoding="utf-8"))
        if isinstance(content, dict) and "rows" not in content:
            raise TableError(f"{file}: must hold a list of rows, or an object with 'rows'")
        return pd.DataFrame(content["rows"] if isinstance(content, dict) else content)
    raise TableError(f"{file}: must be a .csv, .parquet or .json file, or the folder of a study")


def numbers(frame: pd.DataFrame, name: str) -> Floats:
    """Return a column as float64, NaN for missing values.

    Raises:
        ExpressionError: there is no such column, or it holds no numbers.
    """
    series = column(frame, name)
    try:
        return series.to_numpy(dtype=np.float64, na_value=np.nan)
    except (TypeError, ValueError):
        raise ExpressionError(f"column '{name}' must hold numbers to be an objective or a budget") from None


def group_numbers(frame: pd.DataFrame, by: Sequence[str]) -> Ints:
    """Return a group number for each row, by the values of the columns `by`; from 0, in table order.

    Missing values are equal to each other. Without columns all rows are one group.

    Raises:
        ExpressionError: there is no such column.
    """
    if not by:
        return np.zeros(len(frame), np.int64)
    for name in by:
        column(frame, name)
    grouped = frame.groupby(list(by), sort=False, dropna=False, observed=True)
    return np.asarray(grouped.ngroup(), np.int64)


class Goal(NamedTuple):
    """A column and its direction: 'max' or 'min'."""

    column: str
    direction: str

    @property
    def sign(self) -> float:
        """The factor that turns values into costs, which are minimised."""
        return 1.0 if self.direction == "min" else -1.0


def checked_goals(pairs: Iterable[tuple[str, str]]) -> list[Goal]:
    """Return (column, direction) pairs as goals.

    Raises:
        ExpressionError: there is none, a direction is unknown, or a column is named twice.
    """
    goals = [Goal(*pair) for pair in pairs]
    if not goals:
        raise ExpressionError("objectives must hold at least one column, e.g. accuracy:max")
    for name, direction in goals:
        if direction not in ("max", "min"):
            raise ExpressionError(f"objective '{name}' must be followed by :max or :min, got '{direction}'")
    names = [goal.column for goal in goals]
    twice = [name for name in dict.fromkeys(names) if names.count(name) > 1]
    if twice:
        raise ExpressionError(f"objective '{twice[0]}' is named twice")
    return goals


def parse_goals(text: str) -> list[Goal]:
    """Return the goals that "accuracy:max,energy_uj:min" names.

    Raises:
        ExpressionError: a direction is missing or unknown, or a column is named twice.
    """
    goals = []
    for part in text.split(","):
        name, _, direction = (x.strip() for x in part.partition(":"))
        goals.append((name, direction))
    return checked_goals(goals)


def costs_of(frame: pd.DataFrame, goals: Iterable[Goal]) -> Floats:
    """Return the goals' columns as costs, (row, goal), all minimised.

    Raises:
        ExpressionError: an unknown column, or one that holds no numbers.
    """
    return np.stack([goal.sign * numbers(frame, goal.column) for goal in goals], axis=1)
