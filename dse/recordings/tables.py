"""Tables of recordings and of labels: .csv (commas, semicolons or tabs) and .parquet files."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dse.config.bounds import MOST_COLUMNS
from dse.config.faults import known_names
from dse.recordings import RecordingError
from dse.recordings.labels import label_columns
from dse.records import Array, Floats, Ints

if TYPE_CHECKING:
    import pandas as pd

TABLES = (".csv", ".tsv", ".parquet")
"""Endings of tables."""
_SEPARATORS = (b",", b";", b"\t")
_HEAD_BYTES = 1 << 16


def column_names(path: Path) -> list[str]:
    """Return the columns of a table.

    Raises:
        RecordingError: it cannot be read.
    """
    return [str(x) for x in read_table(path, None, head=True).columns]


def read_table(path: Path, columns: list[str] | None, *, head: bool = False) -> pd.DataFrame:
    """Return some columns of a .csv or .parquet table.

    Args:
        path: an existing file.
        columns: their names; None: all.
        head: whether to return no rows.

    Raises:
        RecordingError: it cannot be read, or has no such column.
    """
    import pandas as pd
    import pyarrow

    if path.stat().st_size == 0:
        raise RecordingError(f"{path.name}: the file is empty")
    columns = None if columns is None else list(dict.fromkeys(columns))
    try:
        if path.suffix in (".csv", ".tsv"):
            separator, decimal = _marks(path)
            rows = 0 if head else None
            return pd.read_csv(
                path, sep=separator, decimal=decimal, usecols=columns, nrows=rows, low_memory=False
            )
        if path.suffix == ".parquet":
            if head:
                import pyarrow.parquet

                empty: pd.DataFrame = pyarrow.parquet.read_schema(path).empty_table().to_pandas()
                return empty
            return pd.read_parquet(path, columns=columns)
    except (ValueError, OSError, pyarrow.ArrowException) as error:
        raise RecordingError(
            f"{path.name}: the file cannot be read ({' '.join(str(error).split())})"
        ) from None
    raise RecordingError(f"{path.name}: a table must be a .csv or .parquet file")


_POINT = re.compile(rb"(?<![\d.])\d+\.\d+(?![\d.])")  # of a number, not of a date


def _marks(path: Path) -> tuple[str, str]:
    """Return what separates the columns of a CSV file, and what the decimals of its numbers.

    The first is the most frequent of comma, semicolon and tab in the first line; commas between the digits of
    the next lines are decimal where they separate no columns, and no number has a point.

    Raises:
        RecordingError: there are more columns than `bounds` allows.
    """
    with path.open("rb") as file:
        first, head = file.readline(), file.read(_HEAD_BYTES)
    separator = max(_SEPARATORS, key=first.count)
    if (n := first.count(separator) + 1) > MOST_COLUMNS:
        raise RecordingError(f"{path.name}: a table must have at most {MOST_COLUMNS} columns, got {n}")
    has_comma = separator != b"," and re.search(rb"\d,\d", head) and not _POINT.search(head)
    return separator.decode(), "," if has_comma else "."


def place(path: Path, row: int) -> str:
    """Return where a row of a table is, from 0, as a user finds it: its line in a CSV file."""
    return f"line {row + 2}" if path.suffix in (".csv", ".tsv") else f"row {row}"


def missing(path: Path, names: Iterable[str], known: list[str]) -> list[str]:
    """Return a sentence for each column that a table lacks."""
    return [
        f"{path.name}: no column '{name}'; {known_names(name, known)}" for name in names if name not in known
    ]


def numbers(table: pd.DataFrame, column: str, path: Path) -> Floats:
    """Return a column as float64.

    Raises:
        RecordingError: it holds something else, or a value is missing.
    """
    values = table[column].to_numpy()
    if values.dtype.kind not in "biuf":
        raise RecordingError(
            f"{path.name}: column '{column}' must hold numbers, got {first_text(table[column], path)}"
        )
    if np.isnan(values).any():
        raise RecordingError(
            f"{path.name}: column '{column}' is empty or NaN in {place(path, int(np.isnan(values).argmax()))}"
        )
    return np.asarray(values, dtype=np.float64)


def first_text(column: pd.Series[Any], path: Path) -> str:
    """Return the first value of a column that is no number, and where it is."""
    for row, value in enumerate(column.tolist()):
        try:
            float(value)
        except (TypeError, ValueError):
            return f"{str(value)!r} in {place(path, row)}"
    return f"{column.dtype}"


def check_complete(table: pd.DataFrame, columns: Iterable[str], path: Path) -> None:
    """Raise a RecordingError where a value of a column is missing."""
    for name in columns:
        if table[name].isna().any():
            row = int(table[name].isna().argmax())
            raise RecordingError(f"{path.name}: '{name}' is empty in {place(path, row)}")


def identity(table: pd.DataFrame, column: str, path: Path) -> list[str]:
    """Return the recording that every row belongs to, as its column names it.

    Raises:
        RecordingError: the table is empty, or a value is missing.
    """
    if table.empty:
        raise RecordingError(f"{path.name}: the table has no rows")
    check_complete(table, [column], path)
    return [str(x) for x in table[column].tolist()]


def numbered(times: Floats, code: Ints | None = None) -> Ints:
    """Return the number of the recording of every row, where one begins whenever time does not rise.

    Args:
        times: (row,).
        code: (row,) numbers of channels, each of which has times of its own; None: rows are samples.
    """
    channel = np.zeros(len(times), np.int64) if code is None else code
    number = np.zeros(len(times), np.int64)
    for one in np.unique(channel):
        rows = np.flatnonzero(channel == one)
        number[rows] = np.concatenate([[0], np.cumsum(np.diff(times[rows]) <= 0)])
    return number


def label_table(path: Path, recording: str, columns: Mapping[str, str]) -> tuple[list[str], dict[str, Array]]:
    """Return the recordings of a label table in its order, and its label columns.

    Args:
        path: of the table.
        recording: its column that names the recording.
        columns: label column -> its name in the table.

    Raises:
        RecordingError: a value is missing, or a recording has two rows.
    """
    table = read_table(path, [recording, *columns.values()])
    order = identity(table, recording, path)
    twice = [name for name, rows in Counter(order).items() if rows > 1]
    if twice:
        raise RecordingError(f"{path.name}: recording '{twice[0]}' has more than one row")
    arrays = {}
    for name in columns.values():
        if table[name].isna().any():
            raise RecordingError(
                f"{path.name}: '{name}' is empty for recording '{order[int(table[name].isna().argmax())]}'"
            )
        arrays[name] = texts_or_numbers(table[name])
    return order, label_columns(arrays, columns, {}, len(order), path.name)


def labels_within(
    table: pd.DataFrame, columns: Mapping[str, str], code: Ints, order: Sequence[str], path: Path
) -> dict[str, Array]:
    """Return label columns of a table of samples, in which all rows of a recording have one value.

    Args:
        table: of samples.
        columns: label column -> its name in the table.
        code: (row,) number of the recording.
        order: names of the recordings, each of which has a row.
        path: of the table.

    Raises:
        RecordingError: a value is missing or changes within a recording.
    """
    first = np.unique(code, return_index=True)[1]
    arrays = {}
    for name in columns.values():
        column = table[name]
        check_complete(table, [name], path)
        values = texts_or_numbers(column)
        other = values != values[first][code]
        if other.any():
            row = int(other.argmax())
            raise RecordingError(
                f"{path.name}: '{name}' must have one value per recording, got "
                f"'{values[first][code[row]]}' and, "
                f"in {place(path, row)}, '{values[row]}' in recording '{order[code[row]]}'"
            )
        arrays[name] = values[first]
    return label_columns(arrays, columns, {}, len(order), path.name)


def texts_or_numbers(column: pd.Series[Any]) -> Array:
    """Return a label column as numbers, or as texts."""
    values = column.to_numpy()
    return values if values.dtype.kind in "biuf" else values.astype(str)
