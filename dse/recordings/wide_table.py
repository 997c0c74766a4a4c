"""Sampled recordings in a wide table, CSV or Parquet: a row per recording, its samples in columns."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Self

import numpy as np

from dse.recordings import RecordingError, npz
from dse.recordings.beside import labels_key, load, names_in
from dse.recordings.borders import end_to_end
from dse.recordings.files import content, locate
from dse.recordings.labels import columns_key, label_columns
from dse.recordings.positions import check_positions, position_faults, positions_key, taxel_positions
from dse.recordings.tables import (
    check_complete,
    column_names,
    missing,
    numbers,
    place,
    read_table,
    texts_or_numbers,
)
from dse.records import Ints, Signals
from dse.registry import param, register


@register("recordings", "wide_table")
@dataclasses.dataclass(frozen=True)
class WideTable:
    """Sampled recordings of a CSV or Parquet table with one row per recording: its labels and its samples.

    The samples of a channel are the columns whose names are a text and a number, in the order of the numbers:
    `left_0`, `left_1`, ... Cells that are empty at the end make a recording shorter.
    """

    file: str = param(
        doc="the .csv or .parquet file: an absolute path, or relative to the YAML file or to $DSE_DATA",
        axis=False,
    )
    step_ms: float = param(doc="sampling period", unit="ms", low=0, low_open=True, axis=False)
    samples: tuple[str, ...] = param(
        doc="beginning of the names of the sample columns, one per channel: `left_` stands for left_0, "
        "left_1, "
        "...; an empty text for columns that are named by numbers alone",
        axis=False,
    )
    columns: Mapping[str, str] = columns_key()
    labels: str | None = labels_key()
    positions: tuple[tuple[int, int], ...] | None = positions_key()

    def __post_init__(self) -> None:
        if not self.samples:
            raise RecordingError("data.samples must contain the beginning of a name, got none")
        check_positions(self.positions)
        for fault in position_faults(self.positions, len(self.samples)):
            raise RecordingError(fault)

    def check(self, base: Path) -> list[str]:
        """Return the faults that the head of the table shows."""
        try:
            path = locate(self.file, base)
            known = column_names(path)
        except RecordingError as error:
            return [str(error)]
        faults = missing(path, self.columns.values(), known) if self.labels is None else self._absent(base)
        lengths = {start: len(sample_columns(known, start)) for start in self.samples}
        faults += [
            f"{path.name}: no column is named '{start}' and a number, as data.samples says"
            for start, n in lengths.items()
            if not n
        ]
        if len(set(lengths.values()) - {0}) > 1:
            texts = ", ".join(f"{n} of '{start}'" for start, n in lengths.items())
            faults.append(
                f"{path.name}: channels must have as many sample columns as each other, got {texts}"
            )
        return faults

    def _absent(self, base: Path) -> list[str]:
        try:
            path = locate(self.labels or self.file, base)
            known = dict.fromkeys(names_in(path))
        except RecordingError as error:
            return [str(error)]
        return [npz.missing(path, name, known) for name in self.columns.values() if name not in known]

    def with_columns_found(self, base: Path) -> Self:
        """Return the component with only the label columns that its table, or that of the labels, holds."""
        try:
            known = names_in(locate(self.labels or self.file, base))
        except RecordingError:
            if self.labels is None:
                raise
            return dataclasses.replace(self, labels=None, columns={})
        columns = {column: name for column, name in self.columns.items() if name in known}
        return dataclasses.replace(self, columns=columns)

    def content(self, base: Path) -> str:
        """Return the hashes of the table and of that of the labels."""
        files = [self.file, *([] if self.labels is None else [self.labels])]
        return " ".join(content(locate(file, base)) for file in files)

    def read(self, base: Path) -> Signals:
        """Return the recordings.

        Raises:
            RecordingError: anything wrong with the table, naming line and column.
        """
        for fault in self.check(base):
            raise RecordingError(fault)
        path = locate(self.file, base)
        known = column_names(path)
        names = [sample_columns(known, start) for start in self.samples]
        flat_names = [name for channel in names for name in channel]
        inside = self.columns.values() if self.labels is None else ()
        table = read_table(path, [*inside, *flat_names])
        if table.empty:
            raise RecordingError(f"{path.name}: the table has no rows")
        check_complete(table, inside, path)
        texts = [name for name in flat_names if table[name].dtype.kind not in "biuf"]
        if texts:
            numbers(table, texts[0], path)
        cube = table[flat_names].to_numpy(np.float64).reshape(len(table), len(names), -1).transpose(0, 2, 1)
        is_sample = ~np.isnan(cube)
        lengths = is_sample.any(axis=2)[:, ::-1].argmax(axis=1)
        lengths = np.where(is_sample.any(axis=(1, 2)), cube.shape[1] - lengths, 0)
        lasts = np.arange(cube.shape[1])[None, :] < lengths[:, None]
        gaps = lasts[..., None] & ~is_sample
        if gaps.any() or not lengths.all():
            row, step, channel = (int(x) for x in np.argwhere(gaps if gaps.any() else ~is_sample)[0])
            raise RecordingError(
                f"{path.name}: column '{names[channel][step]}' must hold a number in "
                f"{place(path, row)}, got none"
            )
        offsets = np.concatenate([[0], np.cumsum(lengths)])
        flat, borders = end_to_end(cube[lasts], offsets, path.name)
        if self.labels is None:
            arrays = {name: texts_or_numbers(table[name]) for name in inside}
        else:
            path = locate(self.labels, base)
            arrays = load(path, self.columns.values())
        columns = label_columns(arrays, self.columns, {}, len(table), path.name)
        return Signals(flat, borders, float(self.step_ms), columns)

    def channel_positions(self, base: Path) -> Ints:
        """Return x, y and plane 0 of every channel, which is a taxel; no file is read."""
        n = len(self.samples)
        return taxel_positions(self.positions, np.arange(n), np.zeros(n, dtype=np.int64))


def sample_columns(names: Sequence[str], start: str) -> list[str]:
    """Return the columns that are named by a text and a number, in the order of the numbers."""
    matches = [(match, name) for name in names if (match := re.fullmatch(rf"{re.escape(start)}(\d+)", name))]
    return [name for match, name in sorted(matches, key=lambda pair: int(pair[0][1]))]
