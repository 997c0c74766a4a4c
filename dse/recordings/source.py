"""What the components that read one file share: labels in it or in a file beside it, faults, and keys."""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

import numpy as np

from dse.recordings import RecordingError, arrays
from dse.recordings.files import content, locate
from dse.recordings.labels import label_columns, shape_faults
from dse.recordings.positions import Positions, check_positions, position_faults, taxel_positions
from dse.records import Array, Ints
from dse.registry import Rule, param


def file_key() -> Any:
    """Declare the key `file` of a component."""
    return param(
        doc="the .npz, .npy, .mat, .h5, .csv or .parquet file: an absolute path, or relative to the YAML "
        "file or to $DSE_DATA",
        axis=False,
    )


def columns_key() -> Any:
    """Declare the key `columns` of a component."""
    rule = Rule(
        "mapping from label column to its name in the file, which holds one value per recording", axis=False
    )
    return dataclasses.field(default_factory=dict, metadata={"rule": rule})


def class_names_key() -> Any:
    """Declare the key `class_names` of a component."""
    rule = Rule("mapping from a label column of integer codes to the array of their names", axis=False)
    return dataclasses.field(default_factory=dict, metadata={"rule": rule})


def labels_key() -> Any:
    """Declare the key `labels` of a component."""
    return param(
        None,
        doc="file of the label columns, one row or element per recording, in their order: .csv, "
        ".parquet, .npz, .npy, .mat or .h5 (default: the columns are in the file of the recordings)",
        axis=False,
    )


class FileSource(ABC):
    """Recordings of one file of named arrays or columns, with labels in it or in another.

    A component says which arrays it needs, how many recordings and taxels their shapes announce, and reads
    them; a table of labels whose rows are named has the key `recording`.
    """

    file: str
    columns: Mapping[str, str]
    labels: str | None = None
    class_names: Mapping[str, str] = {}
    positions: Positions | None = None

    def __post_init__(self) -> None:
        check_positions(self.positions)

    @abstractmethod
    def _names(self) -> list[str]:
        """Return the arrays of the file that are needed beside labels."""

    def _count(self, shapes: arrays.Shapes) -> int | None:
        """Return the number of recordings; None where shapes do not tell."""
        return None

    def _taxels(self, shapes: arrays.Shapes) -> tuple[Ints, Ints] | None:
        """Return the number of the taxel and the plane of every channel; None where shapes do not tell."""
        return None

    def _more_faults(self, path: Path, shapes: arrays.Shapes) -> list[str]:
        """Return further faults that the file's headers show."""
        return []

    def _label_names(self) -> list[str]:
        """Return the arrays that labels need, of the file or of that of the labels."""
        return [*self.columns.values(), *self.class_names.values()]

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
            faults += shape_faults(shapes[beside], self.columns, self.class_names, n, where)
        faults += self._more_faults(path, shapes[self.file])
        if faults or self.positions is None or not (found := self._taxels(shapes[self.file])):
            return faults
        return position_faults(self.positions, int(found[0].max()) + 1) if found[0].size else []

    def with_columns_found(self, base: Path) -> Self:
        """Return the component with only the label columns that its file, or that of the labels, holds."""
        try:
            known = arrays.headers(locate(self.labels or self.file, base))
        except RecordingError:
            if self.labels is None:
                raise
            return self._with({}, labels=None)
        columns = {column: name for column, name in self.columns.items() if name in known}
        return self._with(columns)

    def _with(self, columns: Mapping[str, str], **changes: Any) -> Self:
        """Return the component with other label columns."""
        if self.class_names:
            names = {column: name for column, name in self.class_names.items() if column in columns}
            changes["class_names"] = names
        return dataclasses.replace(self, columns=columns, **changes)  # type: ignore[type-var]

    def content(self, base: Path) -> str:
        """Return the hash of the file, and of that of the labels."""
        files = [self.file, *([] if self.labels is None else [self.labels])]
        return " ".join(content(locate(file, base)) for file in files)

    def channel_positions(self, base: Path) -> Ints | None:
        """Return x, y and plane of every channel.

        Raises:
            RecordingError: the file cannot be read, or positions are given for another number of taxels.
        """
        found = self._taxels({})  # where the keys tell, no file is read
        if found is None:
            path = locate(self.file, base)
            found = self._taxels(arrays.headers(path))
            if found is None or not found[0].size:
                raise RecordingError(f"{path.name}: {self._no_channel()}")
        return taxel_positions(self.positions, *found)

    def _no_channel(self) -> str:
        return "the file has no channel"

    def _loaded(self, base: Path) -> tuple[Path, dict[str, Array]]:
        """Return the path of the file, and its arrays, with those of the labels if it holds them."""
        path = locate(self.file, base)
        return path, arrays.load(
            path, [*self._names(), *(self._label_names() if self.labels is None else [])]
        )

    def _labelled(self, values: Mapping[str, Array], n: int, path: Path, base: Path) -> dict[str, Array]:
        """Return the label columns, each (n,).

        Args:
            values: arrays of the file.
            n: number of recordings.
            path: of the file.
            base: folder of the YAML file.
        """
        if self.labels is not None:
            path = locate(self.labels, base)
            values = arrays.load(path, self._label_names())
        if path.suffix.lower() in arrays.TABLES:
            values = {name: arrays.complete(values[name], name, path) for name in self._label_names()}
        return label_columns(values, self.columns, self.class_names, n, path.name)


def in_a_row(n: int | None) -> tuple[Ints, Ints] | None:
    """Return the taxel and the plane of n channels that are a taxel each."""
    return None if n is None else (np.arange(n), np.zeros(n, np.int64))
