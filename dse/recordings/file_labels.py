"""Labels of recordings that are files: from the rows of a table, or from the folders that they lie in."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

import numpy as np

from dse.config.faults import known_names
from dse.recordings import RecordingError
from dse.recordings.folders import some
from dse.recordings.labels import label_columns
from dse.recordings.tables import column_names, read_table
from dse.records import Array

FILE = "file"
"""Column of a label table with the path of a row's file."""
FOLDER = "folder"


@dataclass(frozen=True)
class Labelled:
    """Files in the order of the recordings, their label columns, each (n,), and what is wrong with these."""

    names: list[str]
    columns: dict[str, Array] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)


def table_files(path: Path) -> list[str]:
    """Return the files that a label table names, in its order.

    Raises:
        RecordingError: the table cannot be read, or a row has no file.
    """
    values = read_table(path, [FILE])[FILE]
    if values.isna().any():
        raise RecordingError(f"{path.name}: '{FILE}' is empty in row {int(values.isna().argmax())}")
    return [PurePosixPath(str(value)).as_posix() for value in values]


def labels_of_table(names: Sequence[str], path: Path, columns: Mapping[str, str]) -> Labelled:
    """Return the files in the order of a table's rows, of which there must be one for each, with its labels.

    Args:
        names: the files.
        path: the table.
        columns: label column -> its name in the table.
    """
    faults: list[str] = []
    try:
        known = column_names(path)
        missing = [name for name in dict.fromkeys((FILE, *columns.values())) if name not in known]
        faults += [f"{path.name}: no column '{name}'; {known_names(name, known)}" for name in missing]
        if FILE in missing:
            return Labelled(list(names), faults=faults)
        order = table_files(path)
        sources = [name for name in dict.fromkeys(columns.values()) if name not in missing]
        table = read_table(path, [FILE, *sources])
    except RecordingError as error:
        return Labelled(list(names), faults=[*faults, str(error)])
    for rule, files in (
        ("one row per file, got several for", [name for name, rows in Counter(order).items() if rows > 1]),
        ("a file for every row, but there is none for", _without(order, names)),
        ("a row for every file, but there is none for", _without(names, order)),
    ):
        if files:
            faults.append(f"{path.name}: must have {rule} {some(files)}")
    for name in sources:
        if table[name].isna().any():
            row = order[int(table[name].isna().argmax())]
            faults.append(f"{path.name}: '{name}' is empty for file '{row}'")
    if faults:
        return Labelled(list(names), faults=faults)
    arrays = {name: table[name].to_numpy() for name in sources}
    arrays = {name: x if x.dtype.kind in "biuf" else x.astype(str) for name, x in arrays.items()}
    return Labelled(order, label_columns(arrays, columns, {}, len(order), path.name))


def labels_of_folders(names: Sequence[str], columns: Mapping[str, str]) -> Labelled:
    """Return the files with the names of the folders that they lie in.

    Args:
        names: the files.
        columns: label column -> `folder` that the file lies in, `folder2` that this one lies in, ...
    """
    known = folder_columns(names)
    missing = [name for name in dict.fromkeys(columns.values()) if name not in known]
    if missing:
        shallow = [name for name in names if name.count("/") == len(known)]
        return Labelled(
            list(names),
            faults=[
                f"data.columns: every file must lie in a folder '{name}', but {some(shallow)} does not; "
                f"{known_names(name, known)}"
                for name in missing
            ],
        )
    above = [name.split("/")[-2::-1] for name in names]
    labels = {
        column: np.array([folders[known.index(name)] for folders in above])
        for column, name in columns.items()
    }
    return Labelled(list(names), labels)


def folder_columns(names: Sequence[str]) -> list[str]:
    """Return `folder`, `folder2`, ...: as many as every file lies in."""
    depth = min((name.count("/") for name in names), default=0)
    return [FOLDER if level == 1 else f"{FOLDER}{level}" for level in range(1, depth + 1)]


def _without(names: Sequence[str], known: Collection[str]) -> list[str]:
    excluded = set(known)
    return [name for name in dict.fromkeys(names) if name not in excluded]
