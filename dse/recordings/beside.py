"""Label columns in a file of their own: a table with a row per recording, or arrays, in their order."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from dse.recordings import RecordingError, npz
from dse.recordings.tables import TABLES, column_names, read_table, texts_or_numbers
from dse.records import Array
from dse.registry import param


def labels_key() -> Any:
    """Declare the key `labels` of a component."""
    return param(
        None,
        doc="file of the label columns, one row or element per recording, in their order: .csv, "
        ".parquet, .npz, "
        ".npy, .mat or .h5 (default: the columns are in the file of the recordings)",
        axis=False,
    )


def names_in(path: Path) -> list[str]:
    """Return the columns or arrays of a label file.

    Raises:
        RecordingError: it cannot be read.
    """
    return column_names(path) if path.suffix.lower() in TABLES else list(npz.headers(path))


def shapes_in(path: Path) -> dict[str, tuple[int, ...]]:
    """Return the shapes of the columns or arrays of a label file.

    Raises:
        RecordingError: it cannot be read.
    """
    if path.suffix.lower() not in TABLES:
        return npz.headers(path)
    table = read_table(path, None)
    return {str(name): (len(table),) for name in table.columns}


def load(path: Path, names: Iterable[str]) -> dict[str, Array]:
    """Return columns or arrays of a label file.

    Raises:
        RecordingError: it cannot be read, or a value is missing.
    """
    if path.suffix.lower() not in TABLES:
        return npz.load(path, names)
    names = list(dict.fromkeys(names))
    table = read_table(path, names)
    for name in names:
        if table[name].isna().any():
            row = int(table[name].isna().argmax())
            raise RecordingError(f"{path.name}: '{name}' is empty for recording {row}")
    return {name: texts_or_numbers(table[name]) for name in names}
