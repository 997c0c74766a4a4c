"""Sampled recordings in a long table, CSV or Parquet: a row per value, with its time and its channel."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np

from dse.recordings import RecordingError
from dse.recordings.borders import end_to_end
from dse.recordings.files import content, locate
from dse.recordings.grid import (
    UNITS_MS,
    grid_of,
    interpolated,
    is_even,
    resample_key,
    resampled,
    time_unit_key,
)
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


@register("recordings", "long_table")
@dataclasses.dataclass(frozen=True)
class LongTable:
    """Sampled recordings of a CSV or Parquet table with one row per value: its time, its channel, the value.

    Recordings come in the order of the label table, without one in the order of their first rows.
    """

    file: str = param(
        doc="the .csv or .parquet file: an absolute path, or relative to the YAML file or to $DSE_DATA",
        axis=False,
    )
    step_ms: float = param(doc="sampling period", unit="ms", low=0, low_open=True, axis=False)
    channels: tuple[str, ...] = param(
        doc="names of the channels, as the column of channels has them, in the order of the input", axis=False
    )
    time: str = param("time", doc="name of the column of times", axis=False)
    channel: str = param("channel", doc="name of the column of channels", axis=False)
    value: str = param("value", doc="name of the column of values", axis=False)
    recording: str | None = param(
        None,
        doc="name of the column that identifies the recording, in both tables (default: a recording begins "
        "where the time of a channel does not rise)",
        axis=False,
    )
    time_unit: str | None = time_unit_key()
    resample: str | None = resample_key()
    labels: str | None = param(
        None,
        doc="label table (.csv or .parquet) with one row per recording (default: the label columns are in "
        "the file, with one value in all rows of a recording)",
        axis=False,
    )
    columns: Mapping[str, str] = columns_key()
    positions: tuple[tuple[int, int], ...] | None = positions_key()

    def __post_init__(self) -> None:
        if not self.channels:
            raise RecordingError("data.channels must contain at least one channel, got none")
        if self.recording is None and self.labels is not None:
            raise RecordingError("data.labels needs data.recording, the column that both tables have")
        check_positions(self.positions)
        for fault in position_faults(self.positions, len(self.channels)):
            raise RecordingError(fault)

    def _columns(self) -> list[str]:
        named = (self.recording, self.time, self.channel, self.value)
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
        columns = {column: name for column, name in self.columns.items() if name in known}
        return dataclasses.replace(self, columns=columns)

    def content(self, base: Path) -> str:
        """Return the hashes of the table and of its label table."""
        files = [self.file, *([] if self.labels is None else [self.labels])]
        return " ".join(content(locate(file, base)) for file in files)

    def read(self, base: Path) -> Signals:
        """Return the recordings.

        Raises:
            RecordingError: anything wrong with the tables, naming recording and channel, or the line.
        """
        for fault in self.check(base):
            raise RecordingError(fault)
        path = locate(self.file, base)
        rows = read_table(path, self._columns())
        channel = self._channel(rows, path)
        times = numbers(rows, self.time, path) * UNITS_MS[self.time_unit or "ms"]
        order, code, columns = self._recordings(rows, channel, times, path, base)
        values = numbers(rows, self.value, path)
        # Rows by recording and channel; the channels of a recording are next to each other.
        place = np.lexsort((np.arange(len(code)), channel, code))
        counts = np.bincount(code * len(self.channels) + channel, minlength=len(order) * len(self.channels))
        counts = counts.reshape(len(order), len(self.channels))
        if not counts.all():
            i, k = (int(x) for x in np.argwhere(counts == 0)[0])
            raise RecordingError(
                f"{path.name}: recording '{order[i]}' has no samples of channel '{self.channels[k]}'"
            )
        borders = np.concatenate([[0], np.cumsum(counts.ravel())])
        parts, n_uneven, widest_ms = [], 0, 0.0
        for i, name in enumerate(order):
            spans = [
                slice(*borders[j : j + 2]) for j in range(i * counts.shape[1], (i + 1) * counts.shape[1])
            ]
            part, gap_ms = self._recording(
                [times[place[span]] for span in spans], [values[place[span]] for span in spans], name, path
            )
            parts.append(part)
            n_uneven, widest_ms = n_uneven + (gap_ms > 0), max(widest_ms, gap_ms)
        offsets = np.cumsum([0, *map(len, parts)])
        flat, ends = end_to_end(np.concatenate(parts), offsets, path.name)
        notes = resampled(n_uneven, len(order), self.step_ms, widest_ms, path.name)
        return Signals(flat, ends, float(self.step_ms), columns, tuple(notes))

    def _channel(self, rows: pd.DataFrame, path: Path) -> Ints:
        """Return the number of the channel of every row."""
        names = identity(rows, self.channel, path)
        number = {name: k for k, name in enumerate(self.channels)}
        strange = [name for name in dict.fromkeys(names) if name not in number]
        if strange:
            raise RecordingError(f"{path.name}: channel '{strange[0]}' is not among data.channels")
        return np.array([number[name] for name in names])

    def _recordings(
        self, rows: pd.DataFrame, channel: Ints, times: Floats, path: Path, base: Path
    ) -> tuple[list[str], Ints, dict[str, Array]]:
        """Return the names of the recordings, the number of each row's, and the label columns."""
        if self.recording is None:
            code = numbered(times, channel)
            order = [str(i) for i in range(int(code.max()) + 1)]
            return order, code, labels_within(rows, self.columns, code, order, path)
        names = identity(rows, self.recording, path)
        order, columns = list(dict.fromkeys(names)), None
        if self.labels is not None:
            order, columns = label_table(locate(self.labels, base), self.recording, self.columns)
        rank = {name: i for i, name in enumerate(order)}
        strange = [name for name in dict.fromkeys(names) if name not in rank]
        if strange:
            raise RecordingError(
                f"{path.name}: recording '{strange[0]}' has no row in the label table {self.labels}"
            )
        code = np.array([rank[name] for name in names])
        if columns is None:
            columns = labels_within(rows, self.columns, code, order, path)
        return order, code, columns

    def _recording(
        self, times: list[Floats], values: list[Floats], name: str, path: Path
    ) -> tuple[Floats, float]:
        """Return a recording (step, channel), and its widest gap in ms if its samples were interpolated."""
        for k, channel in enumerate(times):
            if (np.diff(channel) <= 0).any():
                raise RecordingError(
                    f"{path.name}: the times of channel '{self.channels[k]}' must rise in recording '{name}'"
                )
        if all(len(x) == len(times[0]) and np.allclose(x, times[0]) for x in times) and is_even(
            times[0], self.step_ms
        ):
            return np.stack(values, axis=1), 0.0
        if self.resample is None:
            raise RecordingError(
                f"{path.name}: all channels must have samples every step_ms = {self.step_ms:g} ms, which "
                f"recording '{name}' has not (data.resample: linear interpolates)"
            )
        first_ms, last_ms = max(x[0] for x in times), min(x[-1] for x in times)
        grid = grid_of(first_ms, last_ms, self.step_ms)
        if len(grid) < 2:
            raise RecordingError(
                f"{path.name}: the channels of recording '{name}' must have {self.step_ms:g} ms in common"
            )
        columns = [interpolated(grid, x, y[:, None]) for x, y in zip(times, values, strict=True)]
        return np.concatenate(columns, axis=1), max(float(np.diff(x).max(initial=0)) for x in times)

    def channel_positions(self, base: Path) -> Ints:
        """Return x, y and plane 0 of every channel, which is a taxel; no file is read."""
        n = len(self.channels)
        return taxel_positions(self.positions, np.arange(n), np.zeros(n, dtype=np.int64))
