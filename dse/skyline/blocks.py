"""The front of tables too large for memory, block by block."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from dse import store
from dse.records import Bools
from dse.skyline.admissible import COST, meeting
from dse.skyline.constraints import ExpressionError, named_columns, split_budgets
from dse.skyline.front import Skyline, as_list, skyline
from dse.skyline.goals import Goal, checked_goals, costs_of
from dse.skyline.pareto import non_dominated_by_group
from dse.skyline.table import group_numbers

BLOCK = 1 << 18
"""Rows of a block of a file."""

_OF_CLASS = ("fits", "transductive", "hardware", "task")
"""Rows that differ in these may be excluded separately, or are not compared; so may unknown costs."""


def skyline_of_blocks(
    blocks: Iterable[pd.DataFrame],
    goals: Sequence[tuple[str, str]],
    where: str | Sequence[str] | None = None,
    by: str | Sequence[str] | None = None,
) -> Skyline:
    """Return the front of all blocks together, as `dse.skyline.front.skyline`, in memory for a block.

    The index is the position of a row in all blocks together.

    Args:
        blocks: tables of design points with the same columns.
        goals: (column, 'max' or 'min') pairs.
        where: condition, or several, as of `skyline`.
        by: columns whose values have separate fronts.

    Raises:
        ExpressionError: as in `skyline`; or there is no block.
    """
    checked = checked_goals(goals)
    pending: list[pd.DataFrame] = []
    n_rows, n_pending, n_held = 0, 0, 0
    for block in blocks:
        placed = block.set_axis(pd.RangeIndex(n_rows, n_rows + len(block)))
        pending.append(placed[_needed(placed, checked, where, by)])
        n_rows, n_pending = n_rows + len(block), n_pending + len(pending[-1])
        if n_pending > max(2 * n_held, BLOCK):
            held = pd.concat(pending)
            pending = [held[_needed(held, checked, where, by)]]
            n_held = n_pending = len(pending[0])
    if not pending:
        raise ExpressionError("a front needs at least one block of points")
    rows = skyline(pd.concat(pending), goals, where, by).rows
    return Skyline(rows, [f"{n_rows} points, compared in blocks"])


def _needed(
    frame: pd.DataFrame,
    goals: Sequence[Goal],
    where: str | Sequence[str] | None,
    by: str | Sequence[str] | None,
) -> Bools:
    """Return the rows that can be on the front, or decide which ones may be compared, (row,).

    A row can be on the front if it meets the conditions, and none of its class dominates it: what excludes
    one row of a class excludes all. Of each class the first row is kept, for it may decide what fits, and so
    is the first that meets the conditions that are no budgets, for it may decide which hardware is compared.
    """
    conditions = as_list(where or None)
    names = list(dict.fromkeys([*as_list(by), *(name for name in _OF_CLASS if name in frame)]))
    classes = frame[names]
    if COST in frame:
        classes, names = classes.assign(**{COST: frame[COST].isna()}), [*names, COST]
    group = group_numbers(classes, names)
    needed = np.zeros(len(frame), dtype=bool)
    for some in (np.arange(len(frame)), np.flatnonzero(meeting(frame, split_budgets(conditions)[1]))):
        needed[some[np.unique(group[some], return_index=True)[1]]] = True
    costs = costs_of(frame, goals)
    compared = np.flatnonzero(meeting(frame, conditions) & np.isfinite(costs).all(axis=1))
    needed[compared[non_dominated_by_group(costs[compared], group[compared])]] = True
    return needed


def parquet_skyline(
    path: Path,
    goals: Sequence[tuple[str, str]],
    where: str | Sequence[str] | None = None,
    by: str | Sequence[str] | None = None,
) -> Skyline:
    """Return the front of a Parquet file; only the columns that decide it are read whole.

    Args:
        path: the file.
        goals: (column, 'max' or 'min') pairs.
        where: condition, or several, as of `skyline`.
        by: columns whose values have separate fronts.

    Raises:
        ExpressionError: as in `skyline`.
        StoreError: the file is no longer what dse has written.
    """
    import pyarrow.parquet

    store.verify(Path(path))
    with pyarrow.parquet.ParquetFile(path) as file:
        deciding = {*(name for name, _ in goals), *named_columns(as_list(where or None)), *as_list(by)}
        names = [name for name in file.schema_arrow.names if name in {*deciding, *_OF_CLASS, COST}]
        front = skyline_of_blocks(_blocks(file, names), goals, where, by)
        places = np.sort(front.rows.index.to_numpy())
        parts, start = [], 0
        for block in _blocks(file, None):
            here = places[(places >= start) & (places < start + len(block))]
            if len(here):
                parts.append(block.iloc[here - start].set_axis(here))
            start += len(block)
    rows = pd.concat(parts) if parts else block.iloc[:0]
    return Skyline(rows.loc[front.rows.index], front.notes)


def _blocks(file: Any, names: list[str] | None) -> Iterator[pd.DataFrame]:
    for batch in file.iter_batches(BLOCK, columns=names):
        yield batch.to_pandas()
