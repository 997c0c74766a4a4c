"""Sampled recordings in a table, CSV or Parquet: a row per sample, labels beside them or in another table."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np

from dse.recordings import RecordingError
from dse.recordings.borders import end_to_end
from dse.recordings.files import content, locate
from dse.recordings.grid import UNITS_MS, on_grid, resample_key, time_unit_key
from dse.recordings.labels import columns_key
from dse.recordings.positions import check_positions, position_faults, positions_key, taxel_positions
from dse.recordings.tables import (
    column_names,
    identity,
    label_table,
    labels_within,
    missing,
    numbered,
    numbers,
    read_table,
)
from dse.records import Array, Floats, Ints, Signals
from dse.registry import param, register

if TYPE_CHECKING:
    import pandas as pd


@register("recordings", "table")
@dataclasses.dataclass(frozen=True)
class Table:
    """Sampled recordings of a CSV or Parquet table with one row per sample and a column per channel.

    Recordings come in the order of the label table, without one in the order of their first rows.
    """

    file: str = param(
        doc="the .csv or .parquet file: an absolute path, or relative to the YAML file or to $DSE_DATA",
        axis=False,
    )
    step_ms: float = param(doc="sampling period", unit="ms", low=0, low_open=True, axis=False)
    channels: tuple[str, ...] = param(doc="names of the columns of sensor channels", axis=False)
    recording: str | None = param(
        "recording",
        doc="name of the column that identifies the recording, in both tables; null: a recording "
        "begins where "
        "time does not rise",
        axis=False,
    )
    time_ms: str | None = param(
        None,
        doc="name of the column of sample times, which are checked against step_ms",
        unit="ms",
        axis=False,
    )
    labels: str | None = param(
        None,
        doc="label table (.csv or .parquet) with one row per recording (default: the label columns are "
        "in the "
        "file, with one value in all rows of a recording)",
        axis=False,
    )
    columns: Mapping[str, str] = columns_key()
    positions: tuple[tuple[int, int], ...] | None = positions_key()
    time: str | None = param(
        None, doc="name of the column of sample times, in time_unit; instead of time_ms", axis=False
    )
    time_unit: str | None = time_unit_key()
    resample: str | None = resample_key()

    def __post_init__(self) -> None:
        if not self.channels:
            raise RecordingError("data.channels must contain at least one column, got none")
        check_positions(self.positions)
        for fault in position_faults(self.positions, len(self.channels)):
            raise RecordingError(fault)
        if self.time is not None and self.time_ms is not None:
            raise RecordingError("data.time and data.time_ms exclude each other, got both")
        for key in ("time_unit", "resample") if self.time is None else ():
            if getattr(self, key) is not None and (key == "time_unit" or self.time_ms is None):
                raise RecordingError(f"data.{key} needs data.time, the column of sample times")
        if self.recording is None and self.time is None and self.time_ms is None:
            raise RecordingError("data.recording must name a column where data.time does not, got null")
        if self.recording is None and self.labels is not None:
            raise RecordingError("data.labels needs data.recording, the column that both tables have")
        for name in self.channels:
            if name in (self.recording, self.time_ms, self.time, *self.columns.values()):
                raise RecordingError(
                    f"data.channels must be sensor channels only, got '{name}', which is a label column"
                )

    def _columns(self) -> list[str]:
        """Return the columns of the table of samples that are read."""
        named = (self.recording, self.time_ms, self.time, *self.channels)
        labels = self.columns.values() if self.labels is None else ()
        return [name for name in (*named, *labels) if name is not None]

    def check(self, base: Path) -> list[str]:
        """Return the faults that the heads of the tables show."""
        faults = []
        beside = [] if self.recording is None else [self.recording, *self.columns.values()]
        for file, names in ((self.file, self._columns()), (self.labels, beside)):
            try:
                if file is not None:
                    path = locate(file, base)
                    faults += missing(path, names, column_names(path))
            except RecordingError as error:
                faults.append(str(error))
        return faults

    def with_columns_found(self, base: Path) -> Self:
        """Return the component with only the label columns that its label table, or its table, holds."""
        try:
            known = column_names(locate(self.labels or self.file, base))
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
        samples = read_table(path, self._columns())
        order, code, columns = self._recordings(samples, path, base)
        rows = np.argsort(code, kind="stable")
        lengths = np.bincount(code, minlength=len(order))
        if (lengths == 0).any():
            raise RecordingError(
                f"{path.name}: recording '{order[int((lengths == 0).argmax())]}' has no samples"
            )
        offsets = np.concatenate([[0], np.cumsum(lengths)])
        values = np.stack([numbers(samples, name, path)[rows] for name in self.channels], axis=1)
        notes: list[str] = []
        if self.time is not None or self.time_ms is not None:
            times = self._times(samples, path)[rows]
            if self.resample is None:
                _check_times(times, offsets, self.step_ms, order, path.name)
            else:
                values, offsets, notes = on_grid(
                    times, values, offsets, self.step_ms, order.__getitem__, path.name
                )
        flat, borders = end_to_end(values, offsets, path.name)
        return Signals(flat, borders, float(self.step_ms), columns, tuple(notes))

    def _times(self, samples: pd.DataFrame, path: Path) -> Floats:
        """Return the times of the rows in ms."""
        name = self.time_ms or self.time or ""
        return numbers(samples, name, path) * UNITS_MS[self.time_unit or "ms"]

    def _recordings(
        self, samples: pd.DataFrame, path: Path, base: Path
    ) -> tuple[list[str], Ints, dict[str, Array]]:
        """Return the names of the recordings, the number of each row's, and the label columns."""
        if self.recording is None:
            if samples.empty:
                raise RecordingError(f"{path.name}: the table has no rows")
            code = numbered(self._times(samples, path))
            order = [str(i) for i in range(int(code.max()) + 1)]
            return order, code, labels_within(samples, self.columns, code, order, path)
        names = identity(samples, self.recording, path)
        if self.labels is None:
            order, columns = list(dict.fromkeys(names)), None
        else:
            order, columns = label_table(locate(self.labels, base), self.recording, self.columns)
        rank = {name: i for i, name in enumerate(order)}
        strange = [x for x in dict.fromkeys(names) if x not in rank]
        if strange:
            raise RecordingError(
                f"{path.name}: recording '{strange[0]}' has no row in the label table {self.labels}"
            )
        code = np.array([rank[x] for x in names])
        if columns is None:
            columns = labels_within(samples, self.columns, code, order, path)
        return order, code, columns

    def channel_positions(self, base: Path) -> Ints:
        """Return x, y and plane 0 of every channel, which is a taxel; no file is read."""
        n = len(self.channels)
        return taxel_positions(self.positions, np.arange(n), np.zeros(n, dtype=np.int64))


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
            f"in {_place(i + 1, offsets, order)} (data.resample: linear interpolates)"
        )


def _place(row: int, offsets: Ints, order: list[str]) -> str:
    recording = int(np.searchsorted(offsets, row, side="right")) - 1
    return f"sample {row - offsets[recording]} of recording '{order[recording]}'"
