"""Labels as they come in Python -> label columns, and the file that holds recordings with them."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dse import store
from dse.recordings import RecordingError
from dse.records import Array

FOLDER = "recordings"
"""Where files go that are given no name, below the working folder."""

Labels = Mapping[str, Sequence[Any]] | Sequence[Any]
"""Label columns by name, or the one column `label`."""


def label_arrays(labels: Labels | None, n: int) -> dict[str, Array]:
    """Return label columns, each (n,) numbers or texts.

    Raises:
        RecordingError: a column has another length, or holds something else.
    """
    if labels is None:
        return {}
    columns: Mapping[str, Any] = labels if isinstance(labels, Mapping) else {"label": labels}
    arrays = {}
    for name, values in columns.items():
        array = _array(values)
        if array.dtype.kind == "O" and all(isinstance(x, str) for x in array.ravel()):
            array = array.astype(str)
        if array.shape != (n,):
            raise RecordingError(
                f"labels '{name}' must have one value for each of the {n} recordings, got shape {array.shape}"
            )
        if array.dtype.kind not in "biufU":
            raise RecordingError(f"labels '{name}' must be numbers or texts, got {array.dtype}")
        if array.dtype.kind == "f" and np.isnan(array).any():
            raise RecordingError(f"labels '{name}' is NaN for recording {int(np.isnan(array).argmax())}")
        arrays[str(name)] = array
    return arrays


def _array(values: Any) -> Array:
    """Return values as an array, of objects where they are no numbers or texts."""
    try:
        return np.asarray(values)
    except ValueError:  # lists of different lengths
        array = np.empty(len(values), object)
        array[:] = list(values)
        return array


def stored_name(name: str) -> str:
    """Return the name of a label column's array, which is no other array's."""
    return f"label_{name}"


def place_for(file: str | Path | None, arrays: Mapping[str, Array]) -> Path:
    """Return the absolute path of a new file; one without a name is named by its contents."""
    if file is not None:
        path = Path(file)
        path = path if path.suffix == ".npz" else path.with_name(f"{path.name}.npz")
    else:
        digest = hashlib.sha256()
        for name, array in sorted(arrays.items()):
            digest.update(f"{name} {array.dtype.str} {array.shape}".encode())
            digest.update(np.ascontiguousarray(array).data if array.size else b"")
        path = Path(FOLDER) / f"{digest.hexdigest()[:16]}.npz"
    path = path.absolute()
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


def write(path: Path, arrays: Mapping[str, Array]) -> None:
    """Write arrays to an .npz file, whole or not at all."""
    with store.published(path) as temporary:
        with temporary.open("wb") as file:
            np.savez(file, **arrays)  # type: ignore[arg-type]
