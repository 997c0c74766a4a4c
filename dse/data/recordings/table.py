"""Sampled recordings in a table with a row per sample, or per value: grouped by recording, put on a grid."""

from __future__ import annotations

import dataclasses
from abc import abstractmethod
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from dse.base.records import Array, Floats, Ints, Signals
from dse.base.registry import fixed, register
from dse.data.recordings import RecordingError, arrays
from dse.data.recordings.arrays import complete, numbers
from dse.data.recordings.files import locate
from dse.data.recordings.source import Sampled, end_to_end, in_a_row, label_columns

UNITS_MS = {"s": 1000.0, "ms": 1.0, "us": 1e-3}
_RECORDING = (
    "name of the column that identifies the recording, in both tables; null: a recording begins where time, "
    "in a long table that of a channel, does not rise, or a label changes"
)

Rows = tuple[Ints, list[str], Floats | None, Floats]
"""The series of each row and the names of the series, times (row,) in ms, and values (row, column).

The series of a recording are its channels if each has times of its own, else one, named ''.
"""
Series = tuple[Floats, Floats]
"""Times (sample,) in ms, which rise, and values (sample, channel)."""


@dataclasses.dataclass(frozen=True)
class _Samples(Sampled):
    """Recordings whose samples are rows of a table; they come in the order of the label table, if any."""

    channels: tuple[str, ...] = fixed(
        doc="names of the channels, in the order of the input: columns of the table, or values of its column "
        "of channels"
    )
    _: dataclasses.KW_ONLY
    recording: str | None = fixed(None, doc=_RECORDING)
    time_unit: str | None = fixed(None, doc="unit of the times (default: ms)", choices=tuple(UNITS_MS))
    resample: str | None = fixed(
        None,
        doc="linear: samples at uneven times are interpolated every step_ms, and a note says how many "
        "recordings (default: uneven times are a fault)",
        choices=("linear",),
    )

    def __post_init__(self) -> None:
        if not self.channels:
            raise RecordingError("data.channels must contain at least one channel, got none")
        super().__post_init__()
        if self.recording is None and self.labels is not None:
            raise RecordingError("data.labels needs data.recording, the column that both tables have")

    def _label_names(self) -> list[str]:
        return [*([] if self.recording is None else [self.recording]), *self.columns.values()]

    def _taxels(self, shapes: arrays.Shapes) -> Ints | None:
        return in_a_row(len(self.channels))

    def _times_ms(self, values: Array, name: str, path: Path) -> Floats:
        """Return a column of times; of dates, since the first."""
        dates = arrays.dates_ms(values)
        return numbers(values, name, path) * UNITS_MS[self.time_unit or "ms"] if dates is None else dates

    @abstractmethod
    def _series(self, values: Mapping[str, Array], path: Path) -> Rows:
        """Return what the rows of the table say."""

    def read(self, base: Path) -> Signals:
        """Return the recordings."""
        for fault in self.check(base):
            raise RecordingError(fault)
        path, table = self._loaded(base)
        if len(shapes := {values.shape for values in table.values()}) > 1:
            raise RecordingError(
                f"{path.name}: columns must be of one length, got {sorted(map(str, shapes))}"
            )
        if not len(next(iter(table.values()))):
            raise RecordingError(f"{path.name}: the table has no rows")
        series, names, times, values = self._series(table, path)
        order, code, columns = self._recordings(table, series, times, path, base)
        rows = np.lexsort((series, code))  # by recording, and the series of one next to each other
        n = np.bincount(code * len(names) + series, minlength=len(order) * len(names))
        if not n.all():
            i, k = divmod(int(n.argmin()), len(names))
            of_channel = f" of channel '{names[k]}'" if names[k] else ""
            raise RecordingError(f"{path.name}: recording '{order[i]}' has no samples{of_channel}")
        values, borders = values[rows], np.concatenate([[0], np.cumsum(n)])
        notes: list[str] = []
        if times is not None:
            times, parts, gaps_ms = times[rows], [], []
            for i, name in enumerate(order):
                spans = [slice(*borders[k : k + 2]) for k in range(i * len(names), (i + 1) * len(names))]
                part, gap_ms = on_grid(
                    [(times[span], values[span]) for span in spans], self.step_ms, self.resample is not None,
                    f"{path.name}: recording '{name}'",
                )  # fmt: skip
                parts.append(part)
                gaps_ms.append(gap_ms)
            values, borders = np.concatenate(parts), np.cumsum([0, *map(len, parts)])
            if n_uneven := np.count_nonzero(gaps_ms):
                notes.append(
                    f"{path.name}: {n_uneven} of {len(parts)} recordings have samples at uneven times; they "
                    f"were interpolated every {self.step_ms:g} ms (widest gap {max(gaps_ms):g} ms)"
                )
        flat, ends = end_to_end(values, borders, path.name)
        return Signals(flat, ends, float(self.step_ms), columns, tuple(notes))

    def _recordings(
        self, table: Mapping[str, Array], series: Ints, times: Floats | None, path: Path, base: Path
    ) -> tuple[list[str], Ints, dict[str, Array]]:
        """Return the names of the recordings, the number of each row's, and the label columns."""
        if self.recording is None:
            assert times is not None  # the keys are refused without
            code = numbered(times, series, [table[x] for x in self.columns.values()])
            order = [str(i) for i in range(int(code.max()) + 1)]
            return order, code, self._labels_within(table, code, order, path)
        names = _named(table[self.recording], self.recording, path)
        if self.labels is None:
            order = list(dict.fromkeys(names))
        else:
            beside = locate(self.labels, base)
            rows = arrays.load(beside, self._label_names())
            order = _named(rows[self.recording], self.recording, beside)
            if twice := [name for name, n in Counter(order).items() if n > 1]:
                raise RecordingError(f"{beside.name}: recording '{twice[0]}' has more than one row")
        rank = {name: i for i, name in enumerate(order)}
        if strange := next((name for name in names if name not in rank), None):
            raise RecordingError(
                f"{path.name}: recording '{strange}' has no row in the label table {self.labels}"
            )
        code = np.array([rank[name] for name in names])
        if self.labels is None:
            return order, code, self._labels_within(table, code, order, path)
        return order, code, self._labelled({}, len(order), path, base)

    def _labels_within(
        self, table: Mapping[str, Array], code: Ints, order: Sequence[str], path: Path
    ) -> dict[str, Array]:
        """Return label columns of the table of samples, in which all rows of a recording have one value."""
        first = np.unique(code, return_index=True)[1]
        found = {}
        for name in self.columns.values():
            values = complete(table[name], name, path)
            other = values != values[first][code]
            if other.any():
                row = int(other.argmax())
                raise RecordingError(
                    f"{path.name}: '{name}' must have one value per recording, got "
                    f"'{values[first][code[row]]}' and, in {arrays.place(path, row)}, '{values[row]}' in "
                    f"recording '{order[code[row]]}'"
                )
            found[name] = values[first]
        return label_columns(found, self.columns, {}, len(order), path.name)


@register("recordings", "table")
@dataclasses.dataclass(frozen=True)
class Table(_Samples):
    """Sampled recordings of a CSV or Parquet table with one row per sample and a column per channel.

    Recordings come in the order of the label table, without one in the order of their first rows.
    """

    recording: str | None = fixed("recording", doc=_RECORDING)
    time_ms: str | None = fixed(
        None, doc="name of the column of sample times, which are checked against step_ms", unit="ms"
    )
    time: str | None = fixed(None, doc="name of the column of sample times, in time_unit; instead of time_ms")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.time is not None and self.time_ms is not None:
            raise RecordingError("data.time and data.time_ms exclude each other, got both")
        for key in ("time_unit", "resample") if self.time is None else ():
            if getattr(self, key) is not None and (key == "time_unit" or self.time_ms is None):
                raise RecordingError(f"data.{key} needs data.time, the column of sample times")
        if self.recording is None and self.time is None and self.time_ms is None:
            raise RecordingError("data.recording must name a column where data.time does not, got null")
        for name in self.channels:
            if name in (self.recording, self.time_ms, self.time, *self.columns.values()):
                raise RecordingError(
                    f"data.channels must be sensor channels only, got '{name}', which is a label column"
                )

    def _names(self) -> list[str]:
        named = (self.recording, self.time_ms, self.time, *self.channels)
        return [name for name in named if name is not None]

    def _series(self, values: Mapping[str, Array], path: Path) -> Rows:
        samples = np.stack([numbers(values[name], name, path) for name in self.channels], axis=1)
        time = self.time_ms or self.time
        times = None if time is None else self._times_ms(values[time], time, path)
        return np.zeros(len(samples), np.int64), [""], times, samples


@register("recordings", "long_table")
@dataclasses.dataclass(frozen=True)
class LongTable(_Samples):
    """Sampled recordings of a CSV or Parquet table with one row per value: its time, its channel, the value.

    Recordings come in the order of the label table, without one in the order of their first rows.
    """

    time: str = fixed("time", doc="name of the column of times")
    channel: str = fixed("channel", doc="name of the column of channels")
    value: str = fixed("value", doc="name of the column of values")

    def _names(self) -> list[str]:
        return [name for name in (self.recording, self.time, self.channel, self.value) if name is not None]

    def _series(self, values: Mapping[str, Array], path: Path) -> Rows:
        number = {name: k for k, name in enumerate(self.channels)}
        names = _named(values[self.channel], self.channel, path)
        if strange := next((name for name in names if name not in number), None):
            raise RecordingError(f"{path.name}: channel '{strange}' is not among data.channels")
        times = self._times_ms(values[self.time], self.time, path)
        samples = numbers(values[self.value], self.value, path)[:, None]
        return np.array([number[name] for name in names]), list(self.channels), times, samples


def _named(values: Array, name: str, path: Path) -> list[str]:
    """Return the names in a column, which has no empty cell."""
    complete(values, name, path)
    return [str(x) for x in values.tolist()]


def numbered(times: Floats, code: Ints | None = None, labels: Sequence[Array] = ()) -> Ints:
    """Return the number of the recording of every row: one begins where time does not rise or labels change.

    times, labels: (row,) each. code: (row,) numbers of channels with times of their own; None: rows are
    samples.
    """
    channel = np.zeros(len(times), np.int64) if code is None else code
    number = np.zeros(len(times), np.int64)
    for one in np.unique(channel):
        rows = np.flatnonzero(channel == one)
        begins = np.diff(times[rows]) <= 0
        for label in labels:
            begins |= label[rows][1:] != label[rows][:-1]
        number[rows] = np.concatenate([[0], np.cumsum(begins)])
    return number


def is_even(times_ms: Floats, step_ms: float) -> bool:
    """Return whether times rise by step_ms, to within half of it."""
    return bool((np.abs(np.diff(times_ms) - step_ms) <= step_ms / 2).all())


def on_grid(series: Sequence[Series], step_ms: float, resample: bool, where: str) -> tuple[Floats, float]:
    """Return one recording (step, channel) of its series, with a sample every step_ms, and its widest gap.

    Series of the same even times stay as they are, with gap 0; where `resample` says so, others are
    interpolated where all have values, with their gap in ms, else uneven times are a fault.
    """
    first = series[0][0]
    for times, _ in series:
        if (np.diff(times) <= 0).any():
            k = int((np.diff(times) <= 0).argmax())
            raise RecordingError(
                f"{where}: times must rise, got {times[k]:g} ms and then {times[k + 1]:g} ms in sample "
                f"{k + 1}"
            )
    same = all(len(times) == len(first) and np.allclose(times, first) for times, _ in series)
    if same and is_even(first, step_ms):
        return np.concatenate([values for _, values in series], axis=1), 0.0
    if not resample:
        steps = np.abs(np.diff(first) - step_ms)
        k = int(steps.argmax()) if len(steps) else 0
        got = f"{', '.join(f'{x:g}' for x in first[k : k + 2])} in sample {k + 1}" if same else "others"
        raise RecordingError(
            f"{where}: all channels must have times that rise by step_ms = {step_ms:g} ms, got {got} "
            "(data.resample: linear interpolates)"
        )
    begin_ms, end_ms = max(times[0] for times, _ in series), min(times[-1] for times, _ in series)
    n = int(np.floor((end_ms - begin_ms) / step_ms + 1e-6)) + 1
    if n < 2:
        raise RecordingError(
            f"{where}: must last a step of {step_ms:g} ms in all channels, got {end_ms - begin_ms:g}"
        )
    grid_ms = begin_ms + step_ms * np.arange(n)
    columns = [np.interp(grid_ms, times, column) for times, values in series for column in values.T]
    return np.stack(columns, axis=1), max(float(np.diff(times).max(initial=0)) for times, _ in series)
