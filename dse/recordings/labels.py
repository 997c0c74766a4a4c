"""Label columns: one value per recording, codes replaced by their names where the file has names."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dse.recordings import RecordingError
from dse.records import Array, Ints


def label_columns(
    arrays: Mapping[str, Array],
    columns: Mapping[str, str],
    class_names: Mapping[str, str],
    n: int,
    where: str,
) -> dict[str, Array]:
    """Return each column as (n,) numbers, or strings without blanks at their ends.

    Args:
        arrays: arrays of the file by name.
        columns: column name -> array name.
        class_names: column name -> array of the names that the column's integer codes index.
        n: number of recordings.
        where: the file's name, for errors.

    Raises:
        RecordingError: a column has not one value per recording, holds NaN, or a code has no name.
    """
    for fault in shape_faults({name: x.shape for name, x in arrays.items()}, columns, class_names, n, where):
        raise RecordingError(fault)
    labels = {}
    for column, source in columns.items():
        values = arrays[source]
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
        if shapes.get(source, (-1,)) not in ((n,), (-1,))
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
