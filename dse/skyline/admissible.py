"""Which rows of a table may be compared on a front.

A row is admissible if its classifier has not seen the labels that it predicts (it is not transductive) and
if it fits its hardware; if no row fits a hardware, all its rows are admissible.
"""

from __future__ import annotations

from collections.abc import Sequence
from collections.abc import Set as AbstractSet

import numpy as np
import pandas as pd

from dse import registry
from dse.records import Bools, Ints
from dse.skyline.table import group_numbers, numbers

_NAMED_IN_NOTE = 5  # rows that a note names; it only counts the others


def honest(rows: pd.DataFrame) -> Bools:
    """Return which rows' classifiers have not seen the labels that they predict, (row,)."""
    try:
        leaky = rows["transductive"].astype("boolean")
    except (KeyError, TypeError, ValueError):  # a user's column of this name with other content
        return np.ones(len(rows), dtype=bool)
    return ~leaky.fillna(False).to_numpy(dtype=bool)


def fitting(rows: pd.DataFrame) -> Bools:
    """Return which rows fit their hardware, (row,); all rows of a hardware that none fits."""
    fits = _fits(rows)
    chips = _chips(rows)
    return np.asarray(fits | ~np.isin(chips, chips[fits]))


def admissible(rows: pd.DataFrame) -> Bools:
    """Return which rows a front compares, (row,): the honest ones that fit their hardware, if any fits it."""
    keep = honest(rows)
    of_hardware = [name for name in ("fits", "hardware") if name in rows.columns]
    keep[keep] = fitting(rows.loc[keep, of_hardware])
    return keep


def leave_out_leaky(rows: pd.DataFrame, named: AbstractSet[str]) -> tuple[pd.DataFrame, list[str]]:
    """Return the honest rows and a note on the others; all rows if `transductive` is named."""
    if "transductive" in named:
        return rows, []
    keep = honest(rows)
    n = int((~keep).sum())
    if not n:
        return rows, []
    noun, whose = ("row", "its classifier has") if n == 1 else ("rows", "their classifiers have")
    return rows[keep], [f"{n} transductive {noun} excluded: {whose} seen the labels"]


def leave_out_misfits(rows: pd.DataFrame, named: AbstractSet[str]) -> tuple[pd.DataFrame, list[str]]:
    """Return the rows that fit their hardware and notes on the others; all rows if `fits` is named."""
    if "fits" not in rows.columns or "fits" in named:
        return rows, []
    keep = fitting(rows)
    unnamed = pd.Series("the chip", rows.index, dtype=object)
    chips = rows["hardware"].astype(object).fillna(unnamed) if "hardware" in rows else unnamed
    notes = [
        f"{n} {'row' if n == 1 else 'rows'} excluded: {'it does' if n == 1 else 'they do'} not fit {chip}"
        for chip, n in chips[~keep].value_counts(sort=False).items()
    ]
    notes += [
        f"no design fits {chip}; costs assume a larger chip of the same kind"
        for chip in chips[keep & ~_fits(rows)].unique()
    ]
    return rows[keep], notes


def leave_out_copies(rows: pd.DataFrame, named: AbstractSet[str]) -> tuple[pd.DataFrame, list[str]]:
    """Return the points on the first hardware if no named column depends on hardware, and a note."""
    depends = "hardware" in named or bool(named & registry.columns("hardware").keys())
    if depends or "hardware" not in rows or rows["hardware"].isna().any() or rows["hardware"].nunique() < 2:
        return rows, []
    first = rows["hardware"].iloc[0]
    return rows[rows["hardware"] == first], [f"points on {first}: no objective depends on hardware"]


def leave_out_unmeasured(frame: pd.DataFrame, names: Sequence[str]) -> tuple[pd.DataFrame, list[str]]:
    """Return the rows whose named columns are finite, and one note per column and kind of missing value."""
    keep = np.ones(len(frame), dtype=bool)
    notes = []
    of_hardware = registry.columns("hardware")
    for name in names:
        values = numbers(frame, name)
        is_cost = name in of_hardware and "hardware" in frame
        for kind, wrong in (("NaN", np.isnan(values)), ("infinite", np.isinf(values))):
            if wrong.any():
                chips = " and ".join(dict.fromkeys(map(str, frame["hardware"][wrong]))) if is_cost else ""
                why = f" ({chips} cannot run them, or its costs are known only as intervals)" if chips else ""
                notes.append(f"{_row_names(frame, wrong)} excluded: {name} is {kind}{why}")
                keep &= ~wrong
    return frame[keep], notes


def _fits(rows: pd.DataFrame) -> Bools:
    """Return which rows fit; a row without a value fits only if no row of its hardware has a value.

    A column `fits` with other values than true, false and missing is not about hardware: all rows fit.
    """
    try:
        fits = rows["fits"].astype("boolean")
    except (KeyError, TypeError, ValueError):
        return np.ones(len(rows), dtype=bool)
    chips = _chips(rows)
    answered = np.isin(chips, chips[fits.notna().to_numpy()])
    return np.where(fits.isna(), ~answered, fits.fillna(False).to_numpy(dtype=bool))


def _chips(rows: pd.DataFrame) -> Ints:
    """Return the number of each row's hardware; without a column `hardware`, all rows have the same."""
    return group_numbers(rows, ["hardware"] if "hardware" in rows else [])


def _row_names(frame: pd.DataFrame, mask: Bools) -> str:
    noun, labels = ("trial", frame["trial"]) if "trial" in frame.columns else ("row", frame.index.to_series())
    names = list(dict.fromkeys(map(str, labels[mask])))
    more = f" and {len(names) - _NAMED_IN_NOTE} more" if len(names) > _NAMED_IN_NOTE else ""
    rows = "" if len(names) == mask.sum() else f" ({mask.sum()} rows)"
    return f"{noun}{'s' if len(names) > 1 else ''} {', '.join(names[:_NAMED_IN_NOTE])}{more}{rows}"
