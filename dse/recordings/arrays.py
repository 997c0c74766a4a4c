"""Named arrays of .npy, .mat and HDF5 files, by the functions that `npz` has for .npz files.

The array of an .npy file is named `array`. One of HDF5 has its path, such as `touch/pressure`. MATLAB
writes vectors as matrices with one row or column, which are vectors here; a cell of texts is an array of
texts, and a cell of matrices is recordings of different lengths.
"""

from __future__ import annotations

import functools
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from dse.recordings import RecordingError
from dse.records import Array
from dse.store import DAMAGED_ARCHIVE

ONE = "array"
"""Name of the array of an .npy file."""
SUFFIXES = (".npy", ".mat", ".h5", ".hdf5")
_HDF5 = b"\x89HDF\r\n\x1a\n"
_MATLAB_HEADER = 512  # bytes before the HDF5 part of a MATLAB 7.3 file


def is_one(path: Path) -> bool:
    """Return whether a file is one of those that this module reads, by its ending."""
    return path.suffix.lower() in SUFFIXES


def load(path: Path, names: Iterable[str] | None = None) -> dict[str, Array]:
    """Return the arrays of a file; of a cell of matrices an array of objects, each (step, channel).

    Args:
        path: an existing file.
        names: those to read; None: all.

    Raises:
        RecordingError: the file cannot be read.
    """
    chosen = None if names is None else set(names)
    if path.stat().st_size == 0:
        raise RecordingError(f"{path.name}: the file is empty")
    try:
        if path.suffix.lower() == ".npy":
            return {ONE: np.load(path, allow_pickle=False)}
        with path.open("rb") as file:
            head = file.read(_MATLAB_HEADER + len(_HDF5))
        if _HDF5 in (head[: len(_HDF5)], head[_MATLAB_HEADER:]):
            return _hdf5(path, chosen)
        return _matlab(path, chosen)
    except RecordingError:
        raise
    except Exception as error:  # readers of damaged files raise anything
        reason = " ".join(str(error).split())
        if "Object arrays" in reason:
            raise RecordingError(pickled(path.name, ONE)) from None
        kind = {".npy": "a NumPy .npy", ".mat": "a MATLAB"}.get(path.suffix.lower(), "an HDF5")
        raise RecordingError(
            f"{path.name}: the file cannot be read: it is not {kind} file, or is truncated ({reason})"
        ) from None


def headers(path: Path) -> dict[str, tuple[int, ...]]:
    """Return the shape of every array; recordings of different lengths are (n, -1, channel).

    Raises:
        RecordingError: as of `load`.
    """
    if path.suffix.lower() == ".npy" and path.stat().st_size:
        try:
            return {ONE: np.load(path, mmap_mode="r", allow_pickle=False).shape}
        except DAMAGED_ARCHIVE:
            pass  # `load` says why
    return {name: shape_of(array) for name, array in load(path).items()}


def shape_of(array: Array) -> tuple[int, ...]:
    """Return the shape of an array; of recordings of different lengths (n, -1, channel)."""
    if array.dtype.kind != "O":
        return array.shape
    widths = {x.shape[1] for x in array if isinstance(x, np.ndarray) and x.ndim == 2}
    return (len(array), -1, widths.pop()) if len(widths) == 1 else (len(array),)


def pickled(file: str, name: str) -> str:
    """Return the sentence for an array of Python objects."""
    return (
        f"{file}: array '{name}' holds Python objects, such as recordings of different lengths, which are "
        "not read as they may run code; lay the recordings end to end and add their borders (key offsets), "
        "or write them with dse.data.from_arrays"
    )


def _matlab(path: Path, names: set[str] | None) -> dict[str, Array]:
    from scipy.io import loadmat

    if not _survives(path, path.stat().st_mtime_ns):
        raise ValueError("its reader crashes")
    variables = loadmat(path, variable_names=None if names is None else sorted(names))
    return {
        name: _plain(value)
        for name, value in variables.items()
        if isinstance(value, np.ndarray) and not name.startswith("__") and value.dtype.names is None
    }


@functools.cache
def _survives(path: Path, modified_ns: int) -> bool:
    """Return whether a process survives reading a MATLAB file: scipy crashes on some damaged ones.

    An exception there is one here too. -P: modules of the current folder, which may be anybody's, do not run.
    """
    code = "import sys; from scipy.io import loadmat; loadmat(sys.argv[1])"
    command = [sys.executable, "-P", "-c", code, str(path)]
    return subprocess.run(command, capture_output=True, check=False).returncode in (0, 1)


def _plain(value: Array) -> Array:
    """Return a MATLAB matrix as an array: vectors with one axis, cells of texts as texts."""
    if value.ndim == 2 and 1 in value.shape and value.size:
        value = value.ravel()
    if value.dtype.kind == "O":
        cells = [np.asarray(x) for x in value.ravel()]
        if cells and all(x.dtype.kind in "US" and x.size <= 1 for x in cells):
            return np.array(["".join(map(str, x.ravel())) for x in cells])
        return _recordings(cells)
    if value.dtype.kind in "US":
        return np.char.rstrip(value)
    return value


def _recordings(cells: list[Array]) -> Array:
    """Return matrices as an array of objects, each (step, channel)."""
    array = np.empty(len(cells), object)
    for i, cell in enumerate(cells):
        array[i] = cell.reshape(-1, 1) if cell.ndim == 1 or 1 in cell.shape[:1] else cell
    return array


def _hdf5(path: Path, names: set[str] | None) -> dict[str, Array]:
    try:
        import h5py
    except ImportError:
        raise RecordingError(
            f"{path.name}: HDF5 files need h5py, which is not installed; pip install 'dse[h5]'"
        ) from None
    is_matlab = path.suffix.lower() == ".mat"
    arrays: dict[str, Array] = {}
    with h5py.File(path, "r") as file:

        def text(codes: Array) -> str:
            return "".join(map(chr, codes.ravel())).rstrip("\0 ")

        def read(item: Any) -> Array:
            value = np.asarray(item[()])
            kind = item.attrs.get("MATLAB_class", b"")
            if h5py.check_string_dtype(item.dtype) is not None:
                return np.asarray(item.asstr()[()]).astype(str)
            if kind == b"char":
                return np.array([text(value)])
            if h5py.check_ref_dtype(item.dtype) is not None:
                cells = [file[reference] for reference in value.ravel()]
                if all(cell.attrs.get("MATLAB_class") == b"char" for cell in cells):
                    return np.array([text(np.asarray(cell[()])) for cell in cells])
                return _recordings([np.asarray(cell[()]).T for cell in cells])
            return _plain(value.T) if is_matlab else value

        def visit(name: str, item: Any) -> None:
            if (
                isinstance(item, h5py.Dataset)
                and not name.startswith("#")
                and (names is None or name in names)
            ):
                arrays[name] = read(item)

        file.visititems(visit)
    return arrays
