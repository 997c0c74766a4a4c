"""Event arrays in .npz, HDF5 and .csv files: an array or column each for t, x, y, p, or one array with these.

Arrays are found by their usual names, at the top or in a group (`events/t`); other names are given by the key
`arrays`. A `taxel` may stand for x, and then y is 0. Integer times are microseconds unless `time_unit` says
so; floating-point times need it. Polarity is 1 for ON, 0 or -1 for OFF. Arrays are read in blocks,
compressed or not; a .csv file is read at once.
"""

from __future__ import annotations

import abc
import re
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from dse.config.faults import known_names
from dse.recordings import RecordingError
from dse.recordings.formats import BLOCK_EVENTS, Broken, open_file
from dse.recordings.npz import read_header
from dse.records import Array, Block
from dse.registry import register
from dse.store import DAMAGED_ARCHIVE

USUAL = {
    "t": ("t", "ts", "t_us", "time", "times", "timestamp", "timestamps"),
    "x": ("x", "xs", "taxel"),
    "y": ("y", "ys"),
    "p": ("p", "ps", "pol", "polarity", "polarities"),
}
"""Field -> the names that it usually has, without regard to case."""
UNITS_US = {"s": 1e6, "ms": 1e3, "us": 1.0, "ns": 1e-3}

_NUMBERS = "iubf"
_LONGEST_HEADER = 1 << 12
_LARGEST_ADDRESS = (1 << 31) - 1
_LATEST_US = float(1 << 62)

Arrays = Mapping[str, tuple[int, "np.dtype[Any]"]]
"""Name -> length and type of every one-dimensional array of a file."""


@dataclass(frozen=True)
class Column:
    """Where the values of a field are: an array, and which column where the array has columns."""

    array: str
    column: str | None
    length: int

    def of(self, rows: Mapping[str, Array]) -> Array:
        """Return the field's values among rows of the arrays."""
        values = rows[self.array]
        return values if self.column is None else values[self.column]


@dataclass(frozen=True)
class _Opened:
    """An open file: its arrays, and what reads the next n rows of one."""

    arrays: Arrays
    next_rows: Callable[[str, int], Array]


@dataclass(frozen=True)
class _EventArrays(abc.ABC):
    """What the kinds of file share; the keys come from the component that reads the file.

    arrays: t, x, y or p -> its name in the file.
    time_unit: s, ms, us or ns.
    """

    arrays: Mapping[str, str] = field(default_factory=dict)
    time_unit: str | None = None

    @abc.abstractmethod
    def _open(self, path: Path) -> AbstractContextManager[_Opened]:
        """Open a file.

        Raises:
            RecordingError: it cannot be opened.
        """

    def frame(self, path: Path) -> None:
        """Return None: arrays do not say how large the frame is.

        Raises:
            RecordingError: the file cannot be opened, or the arrays are not in it.
        """
        with self._open(path) as opened:
            columns_of(opened.arrays, self.arrays, path.name)

    def blocks(self, path: Path, broken: Broken) -> Iterator[Block]:
        """Yield the events; `broken` hears of arrays that end early and of values that are no numbers.

        Raises:
            RecordingError: the file cannot be opened, the arrays are not in it, or `broken` raised it.
        """
        with self._open(path) as opened:
            columns = columns_of(opened.arrays, self.arrays, path.name)
            if opened.arrays[columns["t"].array][1].kind == "f" and self.time_unit is None:
                raise RecordingError(
                    f"{path.name}: floating-point times need their unit in the key time_unit, one of "
                    f"{', '.join(UNITS_US)}"
                )
            lengths = {name: column.length for name, column in columns.items()}
            n_events = min(lengths.values())
            if n_events < max(lengths.values()):
                got = ", ".join(f"{length} {name}" for name, length in lengths.items())
                broken(f"the arrays must be of one length, got {got}", "keeps the complete events")
            for first in range(0, n_events, BLOCK_EVENTS):
                n = min(BLOCK_EVENTS, n_events - first)
                try:
                    rows = {name: opened.next_rows(name, n) for name in {x.array for x in columns.values()}}
                except DAMAGED_ARCHIVE as problem:
                    reason = " ".join(str(problem).split())
                    broken(
                        f"is damaged after event {first} ({reason})",
                        "keeps the events before the damage, some of which may be wrong",
                    )
                    return
                fields = {name: column.of(rows) for name, column in columns.items()}
                yield _block(fields, UNITS_US[self.time_unit or "us"], first, broken)


@register("recordings.formats", "npz")
@dataclass(frozen=True)
class Npz(_EventArrays):
    """Event arrays of a NumPy .npz file."""

    suffixes: ClassVar[tuple[str, ...]] = (".npz",)

    def matches(self, path: Path, head: bytes) -> bool:
        """Return whether the head is that of a zip archive."""
        return head.startswith(b"PK\x03\x04")

    @contextmanager
    def _open(self, path: Path) -> Iterator[_Opened]:
        arrays, streams = {}, {}
        with open_file(path) as file:
            try:
                archive = zipfile.ZipFile(file)
                for member in (x for x in archive.namelist() if x.endswith(".npy")):
                    stream = archive.open(member)
                    shape, dtype = read_header(stream)
                    if len(shape) == 1 and not dtype.hasobject:
                        name = member.removesuffix(".npy")
                        arrays[name], streams[name] = (shape[0], dtype), stream
            except DAMAGED_ARCHIVE as problem:
                reason = " ".join(str(problem).split())
                raise RecordingError(
                    f"{path.name}: is not an .npz file, or is truncated ({reason})"
                ) from None

            left = {name: length for name, (length, _) in arrays.items()}

            def next_rows(name: str, n: int) -> Array:
                dtype = arrays[name][1]
                data = streams[name].read(n * dtype.itemsize)
                if len(data) < n * dtype.itemsize:
                    raise EOFError(f"'{name}' ends early")
                left[name] -= n
                if not left[name]:
                    streams[name].read(1)  # the check sum is only looked at behind the last byte
                return np.frombuffer(data, dtype)

            yield _Opened(arrays, next_rows)


@register("recordings.formats", "h5")
@dataclass(frozen=True)
class H5(_EventArrays):
    """Event arrays of an HDF5 file; needs h5py (`pip install 'dse[h5]'`)."""

    suffixes: ClassVar[tuple[str, ...]] = (".h5", ".hdf5")

    def matches(self, path: Path, head: bytes) -> bool:
        """Return whether the head is that of an HDF5 file."""
        return head.startswith(b"\x89HDF\r\n\x1a\n")

    @contextmanager
    def _open(self, path: Path) -> Iterator[_Opened]:
        try:
            import h5py
        except ImportError:
            raise RecordingError(
                f"{path.name}: HDF5 files need h5py, which is not installed; pip install 'dse[h5]'"
            ) from None
        arrays: dict[str, tuple[int, np.dtype[Any]]] = {}

        def visit(name: str | bytes, item: Any) -> None:
            if isinstance(name, str) and isinstance(item, h5py.Dataset) and item.ndim == 1:
                arrays[name] = len(item), item.dtype

        open_file(path).close()  # its sentence about a file that cannot be opened is the better one
        try:
            file = h5py.File(path, "r")
            file.visititems(visit)
        except (OSError, RuntimeError, KeyError, ValueError) as problem:  # ValueError: a name that is no text
            reason = " ".join(str(problem).split())
            raise RecordingError(f"{path.name}: is not an HDF5 file, or is truncated ({reason})") from None
        done = dict.fromkeys(arrays, 0)

        def next_rows(name: str, n: int) -> Array:
            first = done[name]
            done[name] = first + n
            return np.asarray(file[name][first : first + n])

        with file:
            yield _Opened(arrays, next_rows)


@register("recordings.formats", "csv")
@dataclass(frozen=True)
class Csv(_EventArrays):
    """A table of events as text: a header with the names of t, x, y and p, a line per event."""

    suffixes: ClassVar[tuple[str, ...]] = (".csv", ".tsv")

    def matches(self, path: Path, head: bytes) -> bool:
        """Return whether the name says so and the first line names the fields of events."""
        names = re.split(r"[,;\t]", head.split(b"\n", 1)[0].decode("utf-8", "replace").lower())
        known = {name.strip(' "\r') for name in names}
        fields = [key for key, usual in USUAL.items() if known.intersection(usual)]
        return path.suffix.lower() in self.suffixes and (len(fields) == 4 or fields == ["t", "x", "p"])

    @contextmanager
    def _open(self, path: Path) -> Iterator[_Opened]:
        import pandas

        open_file(path).close()
        try:
            # The engine of Python guesses the separator; that of C reads ten times as fast.
            separator = next(mark for mark in ",;\t" if mark in _first_line(path) or mark == "\t")
            table = pandas.read_csv(path, sep=separator, skipinitialspace=True, low_memory=False)
        except (ValueError, OSError) as problem:
            reason = " ".join(str(problem).split())
            raise RecordingError(f"{path.name}: is no table of events ({reason})") from None
        values = {}
        for name in table:
            column = table[name]
            is_number = pandas.api.types.is_numeric_dtype(column)
            values[str(name)] = (
                column if is_number else pandas.to_numeric(column, errors="coerce")
            ).to_numpy()
        done = dict.fromkeys(values, 0)

        def next_rows(name: str, n: int) -> Array:
            first = done[name]
            done[name] = first + n
            return values[name][first : first + n]

        yield _Opened({name: (len(rows), rows.dtype) for name, rows in values.items()}, next_rows)


def _first_line(path: Path) -> str:
    with path.open(encoding="utf-8", errors="replace") as file:
        return file.readline(_LONGEST_HEADER)


def columns_of(arrays: Arrays, stated_names: Mapping[str, str], where: str) -> dict[str, Column]:
    """Return where t, x, y and p of the events are; y is absent where x is a taxel.

    Args:
        arrays: the arrays of the file.
        stated_names: field -> name, where the user states it; the other fields are looked for beside it.
        where: the file's name, for errors.

    Raises:
        RecordingError: a given name is not there, or the usual names are those of no events or of several.
    """
    columns = {
        leaf: Column(name, column, length)
        for name, (length, dtype) in arrays.items()
        for leaf, column, kind in _leaves(name, dtype)
        if kind in _NUMBERS
    }
    for name in stated_names.values():
        if name not in columns:
            raise RecordingError(f"{where}: no array '{name}'; {known_names(name, columns)}")
    groups: dict[str, dict[str, str]] = {}
    for leaf in columns:
        group, _, name = leaf.rpartition("/")
        groups.setdefault(group, {})[name.lower()] = leaf
    beside = {name.rpartition("/")[0] for name in stated_names.values()} or groups.keys()
    complete = {}
    for group, names in groups.items():
        if group not in beside:
            continue
        fields = {
            key: stated_names.get(key) or next((names[name] for name in usual if name in names), None)
            for key, usual in USUAL.items()
        }
        if (fields["x"] or "").rpartition("/")[2].lower() == "taxel" and not fields["y"]:
            del fields["y"]
        if all(fields.values()):
            complete[group] = {key: columns[name] for key, name in fields.items() if name}
    distinct = list({tuple(x.items()): x for x in complete.values()}.values())
    if len(distinct) == 1:
        return distinct[0]
    problem = (
        f"events are in {' and in '.join(map(repr, complete))}" if complete else "no arrays t, x, y and p"
    )
    raise RecordingError(f"{where}: {problem}; set the key arrays; {known_names('', columns)}")


def _leaves(name: str, dtype: np.dtype[Any]) -> Iterator[tuple[str, str | None, str]]:
    if dtype.names is None:
        yield name, None, dtype.kind
    else:
        yield from ((f"{name}/{column}", column, dtype[column].kind) for column in dtype.names)


def _block(fields: Mapping[str, Array], unit_us: float, first: int, broken: Broken) -> Block:
    t_us = _times(fields["t"], unit_us)
    addresses = {key: np.asarray(fields[key], dtype=np.float64) for key in ("x", "y") if key in fields}
    polarity = np.asarray(fields["p"], dtype=np.float64)
    valid = (
        np.isfinite(t_us) & (np.abs(t_us) < _LATEST_US)
        if t_us.dtype.kind == "f"
        else np.ones(len(t_us), bool)
    )
    for values in (*addresses.values(), polarity):
        valid &= values == np.rint(values)
    if not valid.all():
        at = int(valid.argmin())
        got = ", ".join(f"{key} = {values[at]}" for key, values in fields.items())
        broken(
            f"event {first + at} must have a time, and whole numbers as address and polarity, got {got}",
            "drops events without them",
            int((~valid).sum()),
        )
        t_us, polarity = t_us[valid], polarity[valid]
        addresses = {key: values[valid] for key, values in addresses.items()}
    x, y = (
        np.clip(addresses.get(key, np.zeros(len(t_us))), -1, _LARGEST_ADDRESS).astype(np.int32)
        for key in "xy"
    )
    polarity = np.where(polarity == -1, 0, np.where(polarity < 0, 255, np.minimum(polarity, 255)))
    return Block(t_us.astype(np.int64), x, y, polarity.astype(np.uint8))


def _times(t: Array, unit_us: float) -> Array:
    """Return times in whole microseconds, as int64 where that is exact, else as float64."""
    if t.dtype.kind in "iub" and unit_us == 1 and t.dtype != np.uint64:
        return t.astype(np.int64)
    return np.rint(t.astype(np.float64) * unit_us)
