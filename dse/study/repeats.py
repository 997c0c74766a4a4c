"""Which runs of a design its numbers are of: all of them, as means, or one alone.

A study's table holds means over repeats (seeds or folds). `last` and `worst` take every number of a point
from one run: the last one, or the one of least accuracy on validation at the end of the window. So the
numbers of a point belong together, whatever is looked at.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from dse.store import StoreError
from dse.study import points
from dse.study.corrected import ACCURACIES, corrected_of
from dse.study.record import RunRecord

if TYPE_CHECKING:
    import pandas

Repeats = Literal["mean", "last", "worst"]
CHOICES: tuple[str, ...] = get_args(Repeats)
_IDENTITY = ("weight_bits", "pruned_after", "phi", "theta", "read_out_ms", "task", "hardware")


def checked(repeats: str) -> str:
    """Return a choice.

    Raises:
        StoreError: it is none.
    """
    if repeats not in CHOICES:
        raise StoreError(f"repeats must be one of {', '.join(CHOICES)}, got {repeats!r}")
    return repeats


def chosen_run(records: Sequence[RunRecord], repeats: str) -> RunRecord:
    """Return the run of a design that `last` or `worst` means; of equally bad ones the first."""
    if repeats == "last":
        return records[-1]
    return min(records, key=lambda record: float(record.measured.columns["accuracy"]))


def over_repeats(folder: Path, table: pandas.DataFrame, repeats: str) -> pandas.DataFrame:
    """Return the points of a study with the numbers of one run of each design; `mean`: unchanged.

    Args:
        folder: of the study.
        table: its points, on any hardware.
        repeats: one of `CHOICES`.

    Raises:
        StoreError: an artefact is damaged, or the points have changed.
    """
    import pandas

    from dse.study import pricing

    if checked(repeats) == "mean" or table.empty:
        return table
    parts = []
    for _, rows in table.groupby("trial", sort=False):
        records = pricing.runs_of(folder, rows)
        if len(records) < 2:
            parts.append(rows)
            continue
        answered, places = pricing.answered(folder, rows, [chosen_run(records, repeats)])
        measured = {name: x[places] for name, x in points.columns_of(answered).items()}
        for chip in rows["hardware"].unique() if "hardware" in rows else ():
            here = (rows["hardware"] == chip).to_numpy()
            for name, x in points.priced(answered, pricing.profile(folder, chip)).items():
                kind = x.dtype if x.dtype.kind == "f" else object
                column = measured.setdefault(name, np.full(len(rows), np.nan, kind))
                column[here] = x[places[here]]
        kept = {name: x for name, x in measured.items() if name in rows and name not in _IDENTITY}
        lost = {x: np.nan for name in ACCURACIES for x in corrected_of(name) if x in rows}  # of the means
        parts.append(rows.assign(**{name: _as(x, rows[name]) for name, x in kept.items()}, **lost))
    return pandas.concat(parts).loc[table.index]


def _as(values: np.ndarray, column: pandas.Series) -> pandas.Series:
    """Return values in the type of the column that they replace, if they fit it."""
    import pandas

    series = pandas.Series(values, column.index).infer_objects()
    return series.astype(column.dtype) if column.dtype.name == "boolean" else series
