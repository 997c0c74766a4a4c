"""Which rows of a table may be compared on a front.

A row is admissible if its classifier has not seen the labels that it predicts (it is not transductive), and
if its hardware can run and hold it. If no row fits a hardware, none is admissible there: only who asks for it
(`oversize`) gets the costs of rows that do not fit, which assume a larger chip of the same kind.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from collections.abc import Set as AbstractSet

import numpy as np
import pandas as pd

from dse.base import registry
from dse.base.records import Bools, Ints
from dse.skyline.constraints import matches, named_columns
from dse.skyline.table import group_numbers, numbers

COST = "energy_uj_high"
"""Column that has a number for each row that its hardware can run: also where only intervals are known."""

_NAMED_IN_NOTE = 5  # rows that a note names; it only counts the others


def honest(rows: pd.DataFrame) -> Bools:
    """Return which rows' classifiers have not seen the labels that they predict, (row,)."""
    try:
        leaky = rows["transductive"].astype("boolean")
    except (KeyError, TypeError, ValueError):  # a user's column of this name with other content
        return np.ones(len(rows), dtype=bool)
    return ~leaky.fillna(False).to_numpy(dtype=bool)


def fitting(rows: pd.DataFrame) -> Bools:
    """Return which rows their hardware can run and hold, (row,)."""
    return np.logical_and(*_on_hardware(rows))


def admissible(rows: pd.DataFrame) -> Bools:
    """Return which rows a front compares, (row,): the honest ones that fit their hardware."""
    return honest(rows) & fitting(rows)


def meeting(frame: pd.DataFrame, conditions: Iterable[str]) -> Bools:
    """Return which rows meet all conditions, (row,).

    Raises:
        ExpressionError: an unknown column, or a condition that cannot be read.
    """
    meets = np.ones(len(frame), dtype=bool)
    for condition in conditions:
        names = named_columns([condition])
        # Without a copy of the other columns; a message names them all.
        part = frame[list(names)] if names and names <= {*frame.columns} else frame
        meets[meets] = matches(condition, part[meets])
    return meets


def candidates(
    frame: pd.DataFrame,
    conditions: Sequence[str],
    named: AbstractSet[str],
    oversize: bool = False,
    goals: AbstractSet[str] | None = None,
) -> tuple[pd.DataFrame, list[str]]:
    """Return the admissible rows that meet the conditions, and notes on the others that meet them.

    Whether a row fits is judged on the whole table: conditions do not change it.

    Args:
        frame: design points.
        conditions: in the language of `dse.skyline.constraints`.
        named: columns that conditions name; `transductive` and `fits` among them admit rows that are
            otherwise left out, but none that its hardware cannot run.
        oversize: admit rows that do not fit their hardware.
        goals: columns that decide; if none depends on hardware, only the points on the first that some row
            fits are returned. None: those on all.

    Raises:
        ExpressionError: as in `meeting`.
    """
    runs, fits = _on_hardware(frame)
    keep = meeting(frame, conditions)
    notes = []
    chip = frame.loc[keep, [name for name in ("hardware",) if name in frame]]
    if goals is not None and (first := _only_hardware(chip, (runs & fits)[keep], named | goals)):
        keep &= np.asarray(frame["hardware"] == first, dtype=bool)
        notes.append(f"points on {first}: no objective depends on hardware")
    if "transductive" not in named:
        leaky = keep & ~honest(frame)
        if n := int(leaky.sum()):
            whose = "its classifier has" if n == 1 else "their classifiers have"
            notes.append(f"{n} transductive {'row' if n == 1 else 'rows'} excluded: {whose} seen the labels")
        keep &= ~leaky
    chips = _chips(frame)
    for chip in dict.fromkeys(chips[keep & ~(runs & fits)].tolist()):
        here = keep & (chips == chip)
        on = frame["hardware"].iloc[int(here.argmax())] if "hardware" in frame else None
        name = "the chip" if pd.isna(on) else str(on)
        n_unable, n_misfits = int((here & ~runs).sum()), int((here & runs & ~fits).sum())
        is_held = bool((here & runs & fits).any())
        if n_unable and not is_held and not n_misfits:
            notes.append(f"{name} can run none of these designs")
        elif n_unable:
            notes.append(f"{_rows(n_unable)} excluded: {name} cannot run {_them(n_unable)}")
        if n_misfits and oversize:
            notes.append(f"{_rows(n_misfits)} priced as if {name} were larger")
        elif n_misfits and "fits" not in named and not is_held:
            notes.append(
                f"no design fits {name}; --oversize (oversize=True) prices them as if it were larger"
            )
        elif n_misfits and "fits" not in named:
            notes.append(
                f"{_rows(n_misfits)} excluded: {'it does' if n_misfits == 1 else 'they do'} not fit {name}"
            )
    keep &= runs
    return frame[keep if oversize or "fits" in named else keep & fits], notes


def leave_out_unmeasured(frame: pd.DataFrame, names: Sequence[str]) -> tuple[pd.DataFrame, list[str]]:
    """Return the rows whose named columns are finite, and one note per column and kind of missing value."""
    keep = np.ones(len(frame), dtype=bool)
    notes = []
    for name in names:
        values = numbers(frame, name)
        for kind, wrong in (("NaN", np.isnan(values)), ("infinite", np.isinf(values))):
            if wrong.any():
                is_cost = "hardware" in frame and name in registry.columns("hardware")
                chips = " and ".join(dict.fromkeys(map(str, frame["hardware"][wrong]))) if is_cost else ""
                why = f" ({chips} cannot run them, or its costs are known only as intervals)" if chips else ""
                notes.append(f"{_row_names(frame, wrong)} excluded: {name} is {kind}{why}")
                keep &= ~wrong
    return frame[keep], notes


def _on_hardware(rows: pd.DataFrame) -> tuple[Bools, Bools]:
    """Return which rows their hardware can run, and which ones it can hold, (row,) each.

    A row without an answer in `fits` cannot run where other rows of its hardware have an answer, and where
    its hardware gives it no energy. A column `fits` with other values than true, false and missing is not
    about hardware: all rows run and fit.
    """
    everything = np.ones(len(rows), dtype=bool)
    try:
        fits = rows["fits"].astype("boolean")
    except (KeyError, TypeError, ValueError):
        return everything, everything
    answered = fits.notna().to_numpy(dtype=bool)
    chips = _chips(rows)
    unable = np.isin(chips, chips[answered])
    if COST in rows and "hardware" in rows:
        unable |= (rows["hardware"].notna() & rows[COST].isna()).to_numpy(dtype=bool)
    return answered | ~unable, fits.fillna(True).to_numpy(dtype=bool)


def _chips(rows: pd.DataFrame) -> Ints:
    """Return the number of each row's hardware; without a column `hardware`, all rows have the same."""
    return group_numbers(rows, ["hardware"] if "hardware" in rows else [])


def _only_hardware(rows: pd.DataFrame, fits: Bools, named: AbstractSet[str]) -> object:
    """Return the first hardware that some row fits; None if a named column depends on hardware."""
    if "hardware" in named or "hardware" not in rows or rows["hardware"].isna().any():
        return None
    if rows["hardware"].nunique() < 2 or named & registry.columns("hardware").keys():
        return None
    return rows["hardware"].iloc[int(fits.argmax())]


def _rows(n: int) -> str:
    return "1 row" if n == 1 else f"{n} rows"


def _them(n: int) -> str:
    return "it" if n == 1 else "them"


def _row_names(frame: pd.DataFrame, mask: Bools) -> str:
    noun, labels = ("trial", frame["trial"]) if "trial" in frame.columns else ("row", frame.index.to_series())
    names = list(dict.fromkeys(map(str, labels[mask])))
    more = f" and {len(names) - _NAMED_IN_NOTE} more" if len(names) > _NAMED_IN_NOTE else ""
    rows = "" if len(names) == mask.sum() else f" ({mask.sum()} rows)"
    return f"{noun}{'s' if len(names) > 1 else ''} {', '.join(names[:_NAMED_IN_NOTE])}{more}{rows}"
