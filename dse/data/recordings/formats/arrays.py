"""Event arrays in .npz, HDF5 and .csv files: an array or column each for t, x, y, p, or one array with these.

Arrays are found by their usual names, at the top or in a group (`events/t`); other names are given by the key
`arrays`. A `taxel` may stand for x, and then y is 0. Integer times are microseconds unless `time_unit` says
so; floating-point times need it. Polarity is 1 for ON, 0 or -1 for OFF.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from dse.base.records import Array, Block
from dse.base.registry import register
from dse.config.faults import known_names
from dse.data.recordings import RecordingError, arrays
from dse.data.recordings.formats import BLOCK_EVENTS, Format, Repairs, block_of, open_file

USUAL = {
    "t": ("t", "ts", "t_us", "time", "times", "timestamp", "timestamps"),
    "x": ("x", "xs", "taxel"),
    "y": ("y", "ys"),
    "p": ("p", "ps", "pol", "polarity", "polarities"),
}
"""Field -> the names that it usually has, without regard to case."""
UNITS_US = {"s": 1e6, "ms": 1e3, "us": 1.0, "ns": 1e-3}

_LARGEST_ADDRESS = (1 << 31) - 1
_LATEST_US = float(1 << 62)


@dataclass(frozen=True)
class _EventArrays(Format):
    """What the kinds of file share; the keys come from the component that reads the file.

    arrays: t, x, y or p -> its name in the file.
    time_unit: s, ms, us or ns.
    """

    arrays: Mapping[str, str] = field(default_factory=dict)
    time_unit: str | None = None

    def frame(self, path: Path) -> None:
        """Return None: arrays do not say how large the frame is; those of events must be there."""
        self._fields(path)

    def _fields(self, path: Path) -> dict[str, tuple[str, str | None]]:
        open_file(path).close()  # its sentence about a file that cannot be opened is the better one
        return fields_of(arrays.described(path), self.arrays, path.name)

    def blocks(self, path: Path, broken: Repairs) -> Iterator[Block]:
        """Yield the events; arrays that end early and values that are no numbers are a fault."""
        places = self._fields(path)
        # All columns of a table: a line with too many cells is a fault only then.
        is_table = arrays.is_table(path)
        loaded = arrays.load(path, None if is_table else [name for name, _ in places.values()])
        fields = {key: _numbers(loaded[name], column) for key, (name, column) in places.items()}
        if fields["t"].dtype.kind == "f" and self.time_unit is None:
            raise RecordingError(
                f"{path.name}: floating-point times need their unit in the key time_unit, one of "
                f"{', '.join(UNITS_US)}"
            )
        lengths = {name: len(values) for name, values in fields.items()}
        got = ", ".join(f"{length} {name}" for name, length in lengths.items())
        broken(
            f"the arrays must be of one length, got {got}",
            "keeps the complete events",
            int(min(lengths.values()) < max(lengths.values())),
        )
        for first in range(0, min(lengths.values()), BLOCK_EVENTS):
            last = min(first + BLOCK_EVENTS, *lengths.values())
            part = {name: values[first:last] for name, values in fields.items()}
            yield from _block(part, UNITS_US[self.time_unit or "us"], first, broken)


@register("recordings.formats", "npz")
@dataclass(frozen=True)
class Npz(_EventArrays):
    """Event arrays of a NumPy .npz file."""

    suffixes: ClassVar[tuple[str, ...]] = (".npz",)
    marks: ClassVar[tuple[bytes, ...]] = (b"PK\x03\x04",)


@register("recordings.formats", "h5")
@dataclass(frozen=True)
class H5(_EventArrays):
    """Event arrays of an HDF5 file; needs h5py (`pip install 'dse-spiking[h5]'`)."""

    suffixes: ClassVar[tuple[str, ...]] = (".h5", ".hdf5")
    marks: ClassVar[tuple[bytes, ...]] = (b"\x89HDF\r\n\x1a\n",)


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


def fields_of(
    described: arrays.Described, stated_names: Mapping[str, str], where: str
) -> dict[str, tuple[str, str | None]]:
    """Return the array, and its column if it has columns, of t, x, y and p; no y where x is a taxel.

    `stated_names`: field -> name, where the user states it; the other fields are looked for beside it.
    """
    places: dict[str, tuple[str, str | None]] = {}
    for name, (shape, dtype) in described.items():
        if len(shape) == 1 and dtype.names is not None:
            places |= {f"{name}/{x}": (name, x) for x in dtype.names if dtype[x].kind in "iubf"}
        elif len(shape) == 1 and dtype.kind in "iubf":
            places[name] = (name, None)
    for name in stated_names.values():
        if name not in places:
            raise RecordingError(f"{where}: no array '{name}'; {known_names(name, places)}")
    groups: dict[str, dict[str, str]] = {}
    for leaf in places:
        group, _, name = leaf.rpartition("/")
        groups.setdefault(group, {})[name.strip().lower()] = leaf
    beside = {name.rpartition("/")[0] for name in stated_names.values()} or groups.keys()
    complete = {}
    for group, names in groups.items():
        fields = {
            key: stated_names.get(key) or next((names[name] for name in usual if name in names), None)
            for key, usual in USUAL.items()
        }
        if (fields["x"] or "").rpartition("/")[2].lower() == "taxel" and not fields["y"]:
            del fields["y"]
        if group in beside and all(fields.values()):
            complete[group] = {key: places[name] for key, name in fields.items() if name}
    distinct = list({tuple(x.items()): x for x in complete.values()}.values())
    if len(distinct) == 1:
        return distinct[0]
    problem = (
        f"events are in {' and in '.join(map(repr, complete))}" if complete else "no arrays t, x, y and p"
    )
    raise RecordingError(f"{where}: {problem}; set the key arrays; {known_names('', places)}")


def _numbers(values: Array, column: str | None) -> Array:
    """Return an array, or a column of it, as numbers; NaN where a cell of a table holds none."""
    if values.dtype.kind in "OUS":
        import pandas

        return np.asarray(pandas.to_numeric(values, errors="coerce"))
    return values if column is None else np.asarray(values[column])


def _block(fields: Mapping[str, Array], unit_us: float, first: int, broken: Repairs) -> Iterator[Block]:
    """Yield the events of some rows as a block; `first` is the number of the first of them."""
    t_us: Any = fields["t"]
    if t_us.dtype.kind not in "iub" or unit_us != 1 or t_us.dtype == np.uint64:
        t_us = np.rint(t_us.astype(np.float64) * unit_us)
    x, y, polarity = (
        np.asarray(fields.get(key, np.zeros(len(t_us))), dtype=np.float64) for key in ("x", "y", "p")
    )
    valid = np.isfinite(t_us) & (np.abs(t_us.astype(np.float64)) < _LATEST_US)
    for values in (x, y, polarity):
        valid &= values == np.rint(values)
    broken.where(
        ~valid,
        "event {} must have a time, and whole numbers as address and polarity, got "
        + ", ".join(f"{key} = {{}}" for key in fields),
        "drops events without them",
        first + np.arange(len(valid)), *fields.values(),
    )  # fmt: skip
    t_us, x, y, polarity = (values[valid] for values in (t_us, x, y, polarity))
    polarity = np.where(polarity == -1, 0, np.where(polarity < 0, 255, np.minimum(polarity, 255)))
    x, y = (np.clip(values, -1, _LARGEST_ADDRESS) for values in (x, y))
    yield from block_of(t_us, x, y, polarity)
