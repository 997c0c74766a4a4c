"""Sampled recordings in a long table, CSV or Parquet: a row per sample, labels in a table of their own."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np

from dse.config.faults import known_names
from dse.recordings import RecordingError
from dse.recordings.files import content, locate
from dse.recordings.labels import columns_key, label_columns
from dse.recordings.positions import check_positions, position_faults, positions_key, taxel_positions
from dse.recordings.time_series import end_to_end
from dse.records import Array, Floats, Ints, Signals
from dse.registry import param, register

if TYPE_CHECKING:
    import pandas as pd


@register("recordings", "table")
@dataclasses.dataclass(frozen=True)
class Table:
    """Sampled recordings of a CSV or Parquet table with one row per sample.

    Recordings come in the order of the label table, without one in the order of their first rows.
    """

    file: str = param(
        doc="the .csv or .parquet file: an absolute path, or relative to the YAML file or to $DSE_DATA",
        axis=False,
    )
    step_ms: float = param(doc="sampling period", unit="ms", low=0, low_open=True, axis=False)
    channels: tuple[str, ...] = param(doc="names of the columns of sensor channels", axis=False)
    recording: str = param(
        "recording", doc="name of the column that identifies the recording, in both tables", axis=False
    )
    time_ms: str | None = param(
        None,
        doc="name of the column of sample times, which are checked against step_ms",
        unit="ms",
        axis=False,
    )
    labels: str | None = param(
        None, doc="label table (.csv or .parquet) with one row per recording", axis=False
    )
    columns: Mapping[str, str] = columns_key()
    positions: tuple[tuple[int, int], ...] | None = positions_key()

    def __post_init__(self) -> None:
        if not self.channels:
            raise RecordingError("data.channels must contain at least one column, got none")
        check_positions(self.positions)
        for fault in position_faults(self.positions, len(self.channels)):
            raise RecordingError(fault)
        if self.columns and self.labels is None:
            raise RecordingError("data.labels is required: the table that holds data.columns")
        for name in self.channels:
            if name in (self.recording, self.time_ms, *self.columns.values()):
                raise RecordingError(
                    f"data.channels must be sensor channels only, got '{name}', which is a label column"
                )

    def check(self, base: Path) -> list[str]:
        """Return the faults that the heads of the tables show."""
        faults = []
        needed = (self.recording, *([] if self.time_ms is None else [self.time_ms]), *self.channels)
        for file, names in ((self.file, needed), (self.labels, (self.recording, *self.columns.values()))):
            try:
                if file is not None:
                    path = locate(file, base)
                    faults += _missing(path, names, column_names(path))
            except RecordingError as error:
                faults.append(str(error))
        return faults

    def with_columns_found(self, base: Path) -> Self:
        """Return the component with only the label columns that its label table, if there is one, holds."""
        try:
            known = [] if self.labels is None else column_names(locate(self.labels, base))
        except RecordingError:
            return dataclasses.replace(self, labels=None, columns={})
        return dataclasses.replace(
            self, columns={column: name for column, name in self.columns.items() if name in known}
        )

    def content(self, base: Path) -> str:
        """Return the hashes of the table and of its label table."""
        files = [self.file, *([] if self.labels is None else [self.labels])]
        return " ".join(content(locate(file, base)) for file in files)

    def read(self, base: Path) -> Signals:
        """Return the recordings.

        Raises:
            RecordingError: anything wrong with the tables, naming recording and sample.
        """
        for fault in self.check(base):
            raise RecordingError(fault)
        path = locate(self.file, base)
        needed = [self.recording, *([] if self.time_ms is None else [self.time_ms]), *self.channels]
        samples = read_table(path, needed)
        identity = _identity(samples, self.recording, path)
        if self.labels is None:
            order = list(dict.fromkeys(identity))
            columns: dict[str, Array] = {}
        else:
            order, columns = self._labels(locate(self.labels, base))
        rank = {name: i for i, name in enumerate(order)}
        strange = [x for x in dict.fromkeys(identity) if x not in rank]
        if strange:
            raise RecordingError(
                f"{path.name}: recording '{strange[0]}' has no row in the label table {self.labels}"
            )
        code = np.array([rank[x] for x in identity])
        rows = np.argsort(code, kind="stable")
        lengths = np.bincount(code, minlength=len(order))
        if (lengths == 0).any():
            raise RecordingError(
                f"{path.name}: recording '{order[int((lengths == 0).argmax())]}' has no samples"
            )
        offsets = np.concatenate([[0], np.cumsum(lengths)])
        if self.time_ms is not None:
            times = _numbers(samples, self.time_ms, path)[rows]
            _check_times(times, offsets, self.step_ms, order, path.name)
        values = np.stack([_numbers(samples, name, path)[rows] for name in self.channels], axis=1)
        flat, borders = end_to_end(values, offsets, path.name)
        return Signals(flat, borders, float(self.step_ms), columns)

    def channel_positions(self, base: Path) -> Ints:
        """Return x, y and plane 0 of every channel, which is a taxel; no file is read."""
        n = len(self.channels)
        return taxel_positions(self.positions, np.arange(n), np.zeros(n, dtype=np.int64))

    def _labels(self, path: Path) -> tuple[list[str], dict[str, Array]]:
        table = read_table(path, [self.recording, *self.columns.values()])
        order = _identity(table, self.recording, path)
        twice = [name for name, rows in Counter(order).items() if rows > 1]
        if twice:
            raise RecordingError(f"{path.name}: recording '{twice[0]}' has more than one row")
        arrays = {}
        for name in self.columns.values():
            if table[name].isna().any():
                raise RecordingError(
                    f"{path.name}: '{name}' is empty for recording '{order[table[name].isna().argmax()]}'"
                )
            values = table[name].to_numpy()
            arrays[name] = values if values.dtype.kind in "biuf" else values.astype(str)
        return order, label_columns(arrays, self.columns, {}, len(order), path.name)


def _check_times(times: Floats, offsets: Ints, step_ms: float, order: list[str], where: str) -> None:
    if (times < 0).any():
        i = int((times < 0).argmax())
        raise RecordingError(
            f"{where}: time must be >= 0 ms, got {times[i]:g} in {_place(i, offsets, order)}"
        )
    steps = np.diff(times)
    steps[offsets[1:-1] - 1] = step_ms
    bad = np.abs(steps - step_ms) > step_ms / 2
    if bad.any():
        i = int(bad.argmax())
        raise RecordingError(
            f"{where}: times must rise by step_ms = {step_ms:g} ms, got {times[i]:g} and {times[i + 1]:g} "
            f"in {_place(i + 1, offsets, order)}"
        )


def _place(row: int, offsets: Ints, order: list[str]) -> str:
    recording = int(np.searchsorted(offsets, row, side="right")) - 1
    return f"sample {row - offsets[recording]} of recording '{order[recording]}'"


def _missing(path: Path, names: Iterable[str], known: list[str]) -> list[str]:
    return [
        f"{path.name}: no column '{name}'; {known_names(name, known)}" for name in names if name not in known
    ]


def _identity(table: pd.DataFrame, column: str, path: Path) -> list[str]:
    if table.empty:
        raise RecordingError(f"{path.name}: the table has no rows")
    if table[column].isna().any():
        raise RecordingError(f"{path.name}: '{column}' is empty in row {table[column].isna().argmax()}")
    return [str(x) for x in table[column].tolist()]


def _numbers(table: pd.DataFrame, column: str, path: Path) -> Floats:
    values = table[column].to_numpy()
    if values.dtype.kind not in "biuf":
        raise RecordingError(f"{path.name}: column '{column}' must hold numbers, got {values.dtype}")
    if np.isnan(values).any():
        raise RecordingError(
            f"{path.name}: column '{column}' is empty or NaN in row {np.isnan(values).argmax()}"
        )
    return np.asarray(values, dtype=np.float64)


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
        if path.suffix == ".csv":
            return pd.read_csv(path, usecols=columns, nrows=0 if head else None, low_memory=False)
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
