"""What the components that read one file share: labels in it or in a file beside it, faults, and keys."""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np

from dse.base.records import Array, Ints, Rasters, Signals
from dse.base.registry import fixed
from dse.data.recordings import RecordingError, arrays
from dse.data.recordings.files import content, locate


def end_to_end(values: Array, offsets: Array | None, where: str) -> tuple[Array, Ints]:
    """Return samples (sum of lengths, channel) float32 and borders (n + 1,) int64, both checked."""
    if values.dtype.kind not in "biuf":
        raise RecordingError(f"{where} must hold numbers, got {values.dtype}")
    if offsets is None:
        if values.ndim != 3:
            raise RecordingError(
                f"{where} must be (recording, sample, channel) without offsets, got shape {values.shape}"
            )
        lengths = unpadded(values)
        values = values[np.arange(values.shape[1])[None, :] < lengths[:, None]]
        offsets = np.concatenate([[0], np.cumsum(lengths)])
    elif values.ndim != 2:
        raise RecordingError(f"{where} must be (sample, channel), got shape {values.shape}")
    borders = checked_offsets(offsets, len(values), where)
    if values.shape[1] == 0:
        raise RecordingError(f"{where} has no channel")
    with np.errstate(over="ignore"):  # what is too large for float32 is reported as infinite
        flat = np.ascontiguousarray(values, dtype=np.float32)
    bad = ~np.isfinite(flat)
    if bad.any():
        sample, channel = (int(x) for x in np.argwhere(bad)[0])
        recording = int(np.searchsorted(borders, sample, side="right")) - 1
        raise RecordingError(
            f"{where} must be finite, got {flat[sample, channel]} in recording {recording}, "
            f"sample {sample - borders[recording]}, channel {channel}"
            + (
                ", before its end: fill gaps, as pandas.DataFrame.interpolate does"
                * bool(np.isnan(flat[bad][0]))
            )
        )
    return flat, borders


def unpadded(cube: Array) -> Ints:
    """Return the steps of each recording of (recording, step, channel) before it is NaN to its end."""
    n, n_steps, _ = cube.shape
    if cube.dtype.kind != "f" or not n_steps or not np.isnan(cube[:, -1]).any():
        return np.full(n, n_steps)
    is_sample: Array = np.asarray((~np.isnan(cube)).any(axis=2))
    return np.where(is_sample.any(axis=1), n_steps - is_sample[:, ::-1].argmax(axis=1), 0)


def checked_offsets(offsets: Array, n_rows: int, where: str, *, may_be_empty: bool = False) -> Ints:
    """Return borders as int64, checked from 0 to n_rows; no recording is empty unless it may be."""
    if offsets.ndim != 1 or len(offsets) < 2 or offsets.dtype.kind not in "iu":
        raise RecordingError(
            f"{where}: offsets must be integers, one more than there are recordings, "
            f"got {offsets.dtype} of shape {offsets.shape}"
        )
    borders = offsets.astype(np.int64)
    lengths = np.diff(borders)
    if (lengths < 0).any():
        i = int((lengths < 0).argmax())
        raise RecordingError(
            f"{where}: offsets must not decrease, got {borders[i]} and then {borders[i + 1]}"
        )
    if borders[0] != 0 or borders[-1] != n_rows:
        raise RecordingError(
            f"{where}: offsets must run from 0 to its end at {n_rows}, got {borders[0]} to {borders[-1]}"
        )
    if not may_be_empty and (lengths == 0).any():
        raise RecordingError(f"{where}: recording {int((lengths == 0).argmax())} is empty")
    return borders


# Event addresses are 16 bits wide in every format that is read.
_HIGHEST = 65535


def position_faults(positions: Sequence[Sequence[int]] | None, channels: Ints | None) -> list[str]:
    """Return what is wrong with [x, y] of every taxel; channels: (channel, 2), None where not known."""
    n_taxels = None if channels is None or not len(channels) else int(channels[:, 0].max()) + 1
    places = [list(place) for place in positions or ()]
    faults = [
        f"data.positions must be distinct, got {place} for taxels {places.index(place)} and {i}"
        for i, place in enumerate(places)
        if place in places[:i]
    ][:1]
    if positions is not None and n_taxels not in (None, len(places)):
        faults.append(f"data.positions must hold [x, y] for each of the {n_taxels} taxels, got {len(places)}")
    return faults


def label_columns(
    arrays: Mapping[str, Array],
    columns: Mapping[str, str],
    class_names: Mapping[str, str],
    n: int,
    where: str,
) -> dict[str, Array]:
    """Return each column as (n,) numbers, or strings without blanks at their ends.

    columns: column name -> array name. class_names: column name -> array of the names that the column's
    integer codes index. where: the file's name, for errors.

    Raises:
        RecordingError: a column has not one value per recording, holds NaN, or a code has no name.
    """
    for fault in shape_faults({name: x.shape for name, x in arrays.items()}, columns, class_names, n, where):
        raise RecordingError(fault)
    labels = {}
    for column, source in columns.items():
        values = as_labels(arrays[source])
        if values.ndim > 1:
            raise RecordingError(
                f"{where}: column '{column}' (array '{source}') must have one value for each recording, or a "
                f"1 in the column of its class, got {values.shape[1]} columns"
            )
        if values.dtype.kind not in "biufUS":
            raise RecordingError(f"{where}: column '{column}' must hold numbers or texts, got {values.dtype}")
        if values.dtype.kind == "f" and np.isnan(values).any():
            raise RecordingError(
                f"{where}: column '{column}' is NaN for recording {np.isnan(values).argmax()}"
            )
        if column in class_names:
            values = _named(values, arrays[class_names[column]], f"{where}: column '{column}'")
        labels[column] = np.char.strip(values.astype(str)) if values.dtype.kind in "US" else values
    return labels


def as_labels(values: Array) -> Array:
    """Return labels as a vector, a matrix of one column too, or of a 1 per row in the column of its class."""
    if values.ndim == 2 and values.shape[1] == 1:
        return values[:, 0]
    if values.ndim == 2 and values.dtype.kind in "biuf":
        classes = values.argmax(axis=1) if values.size else values
        if values.size and np.array_equal(values, np.eye(values.shape[1])[classes]):
            return classes
    return values


def shape_faults(
    shapes: Mapping[str, tuple[int, ...]],
    columns: Mapping[str, str],
    class_names: Mapping[str, str],
    n: int,
    where: str,
) -> list[str]:
    """Return what is wrong with the label arrays as far as their shapes tell; -1 is a length not known."""
    faults = [
        f"{where}: column '{column}' (array '{source}') must have one value for each of the {n} recordings, "
        f"got shape {shapes[source]}"
        for column, source in columns.items()
        if (shape := shapes.get(source, (-1,))) != (-1,) and (len(shape) not in (1, 2) or shape[0] != n)
    ]
    return faults + [
        f"{where}: class_names contains '{column}', which is not a column of {', '.join(columns) or 'it'}"
        for column in class_names
        if column not in columns
    ]


def _named(codes: Ints, names: Array, where: str) -> Array:
    if codes.dtype.kind not in "iu":
        raise RecordingError(f"{where} must hold integer codes to be named by class_names, got {codes.dtype}")
    if names.ndim != 1:
        raise RecordingError(f"{where}: class_names must be a list of names, got shape {names.shape}")
    bad = (codes < 0) | (codes >= len(names))
    if bad.any():
        first = int(bad.argmax())
        raise RecordingError(
            f"{where} has code {codes[first]} for recording {first}, but class_names holds {len(names)} names"
        )
    return np.asarray(names[codes].astype(str))


def columns_key() -> Any:
    """Declare the key `columns` of a component."""
    doc = "mapping from label column to its name in the file, which holds one value per recording"
    return fixed(factory=dict, doc=doc)


def class_names_key() -> Any:
    """Declare the key `class_names` of a component."""
    doc = "mapping from a label column of integer codes to the array of their names"
    return fixed(factory=dict, doc=doc)


@dataclasses.dataclass(frozen=True)
class FileSource(ABC):
    """Recordings of one file of named arrays or columns, with labels in it or in another.

    A component says which arrays it needs, how many recordings their shapes announce, and reads them. One
    with codes as labels has the key `class_names`.
    """

    file: str = fixed(
        doc="the .npz, .npy, .mat, .h5, .ts, .csv or .parquet file: an absolute path, or relative to the "
        "YAML file or to $DSE_DATA"
    )
    _: dataclasses.KW_ONLY
    columns: Mapping[str, str] = columns_key()
    labels: str | None = fixed(
        None,
        doc="file of the label columns, .csv, .parquet, .npz, .npy, .mat, .h5 or .ts: one row or element per "
        "recording, in their order, or by the column data.recording of a table (default: the columns are in "
        "the file of the recordings)",
    )

    @abstractmethod
    def _names(self) -> list[str]:
        """Return the arrays of the file that are needed beside labels."""

    def _count(self, shapes: arrays.Shapes) -> int | None:
        """Return the number of recordings; None where shapes do not tell."""
        return None

    def _more_faults(self, path: Path, shapes: arrays.Shapes) -> list[str]:
        """Return further faults that the file's headers show."""
        return []

    def _codes(self) -> Mapping[str, str]:
        return getattr(self, "class_names", {})

    def _label_names(self) -> list[str]:
        """Return the arrays that labels need, of the file or of that of the labels."""
        return [*self.columns.values(), *self._codes().values()]

    def check(self, base: Path) -> list[str]:
        """Return the faults that the headers of the file, and of that of the labels, show."""
        inside = self._label_names() if self.labels is None else []
        needed = {self.file: [*self._names(), *inside]}
        needed |= {} if self.labels is None else {self.labels: self._label_names()}
        faults: list[str] = []
        shapes: dict[str, arrays.Shapes] = {}
        for file, names in needed.items():
            try:
                path = locate(file, base)
                shapes[file] = known = arrays.headers(path)
            except RecordingError as error:
                faults.append(str(error))
                continue
            faults += [
                arrays.missing(path, name, known) for name in dict.fromkeys(names) if name not in known
            ]
        if self.file not in shapes:
            return faults
        path, beside = locate(self.file, base), self.labels or self.file
        n = self._count(shapes[self.file])
        if n is not None and beside in shapes:
            where = locate(beside, base).name
            faults += shape_faults(shapes[beside], self.columns, self._codes(), n, where)
        return faults + self._more_faults(path, shapes[self.file])

    def with_columns_found(self, base: Path) -> Self:
        """Return the component with only the label columns that its file, or that of the labels, holds."""
        known: arrays.Shapes = {}
        changes: dict[str, Any] = {}
        try:
            known = arrays.headers(locate(self.labels or self.file, base))
        except RecordingError:
            if self.labels is None:
                raise
            changes["labels"] = None
        columns = {column: name for column, name in self.columns.items() if name in known}
        if codes := self._codes():
            changes["class_names"] = {column: name for column, name in codes.items() if column in columns}
        return dataclasses.replace(self, columns=columns, **changes)

    def content(self, base: Path) -> str:
        """Return the hash of the file, and of that of the labels."""
        files = [self.file, *([] if self.labels is None else [self.labels])]
        return " ".join(content(locate(file, base)) for file in files)

    def _loaded(self, base: Path) -> tuple[Path, dict[str, Array]]:
        """Return the path of the file, and its arrays, with those of the labels if it holds them."""
        path = locate(self.file, base)
        return path, arrays.load(
            path, [*self._names(), *(self._label_names() if self.labels is None else [])]
        )

    def _labelled(self, values: Mapping[str, Array], n: int, path: Path, base: Path) -> dict[str, Array]:
        """Return the label columns, each (n,), of the arrays of the file, or of the file of labels."""
        if self.labels is not None:
            path = locate(self.labels, base)
            values = arrays.load(path, self._label_names())
        if arrays.is_table(path):
            values = {name: arrays.complete(values[name], name, path) for name in self._label_names()}
        return label_columns(values, self.columns, self._codes(), n, path.name)


@dataclasses.dataclass(frozen=True)
class Sampled(FileSource):
    """Recordings with a number for every step and channel."""

    step_ms: float = fixed(doc="duration of a step", unit="ms", low=0, low_open=True)
    _: dataclasses.KW_ONLY
    positions: tuple[tuple[int, int], ...] | None = fixed(
        None,
        doc="[x, y] of every taxel, integers (default: x is the number of the taxel, y is 0)",
        low=0,
        high=_HIGHEST,
    )

    def __post_init__(self) -> None:
        for fault in position_faults(self.positions, self._taxels({})):
            raise RecordingError(fault)

    @abstractmethod
    def _taxels(self, shapes: arrays.Shapes) -> Ints | None:
        """Return the taxel and the plane of every channel, (channel, 2); None where shapes do not tell."""

    @abstractmethod
    def read(self, base: Path) -> Signals | Rasters:
        """Return the recordings."""

    def _more_faults(self, path: Path, shapes: arrays.Shapes) -> list[str]:
        return position_faults(self.positions, self._taxels(shapes))

    def channel_positions(self, base: Path) -> Ints:
        """Return x, y and plane of every channel."""
        found = self._taxels({})  # where the keys tell, no file is read
        if found is None:
            path = locate(self.file, base)
            found = self._taxels(arrays.headers(path))
            if found is None or not len(found):
                raise RecordingError(f"{path.name}: {self._no_channel()}")
        for fault in position_faults(self.positions, found):
            raise RecordingError(fault)
        taxel, plane = found.T
        places = np.array(self.positions or [(k, 0) for k in range(taxel.max() + 1)], np.int32)
        return np.column_stack([places[taxel], plane]).astype(np.int32)

    def _no_channel(self) -> str:
        return f"'{self._names()[0]}' has no channel"


def in_a_row(n: int | None) -> Ints | None:
    """Return the taxel and the plane, (n, 2), of channels that are a taxel each."""
    return None if n is None else np.stack([np.arange(n), np.zeros(n, np.int64)], axis=1)
