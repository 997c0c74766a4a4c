"""Named arrays of a file: of .npz, .npy, .mat, HDF5 and .ts, and columns of .csv, .tsv, .txt and .parquet.

The array of an .npy file is named `array`. One of HDF5 has its path, such as `touch/pressure`. MATLAB
writes vectors as matrices with one row or column, which are vectors here; a cell of texts is an array of
texts, and a cell of matrices is recordings of different lengths: an array of objects, each (step, channel).
Nothing is unpickled; every fault is one RecordingError line.
"""

from __future__ import annotations

import contextlib
import functools
import math
import re
import subprocess
import sys
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.lib import format as npy

from dse.base.records import Array, Floats
from dse.config.bounds import MOST_COMPRESSION, UNCOMPRESSED_BYTES
from dse.config.faults import known_names
from dse.data.recordings import RecordingError, ts_file
from dse.data.recordings.csv_head import head_of
from dse.data.recordings.files import TABLES, TEXTS, by_path, part_of, tables_below

if TYPE_CHECKING:
    import pandas as pd

ONE = "array"
"""Name of the array of an .npy file."""
SPLIT = "split"
"""Name of the column that tells the recordings of a published training and test set apart."""
ARRAYS = (".npz", ".npy", ".mat", ".h5", ".hdf5", ".ts")
"""Endings of files of arrays."""

Shapes = Mapping[str, tuple[int, ...]]
Described = Mapping[str, tuple[tuple[int, ...], "np.dtype[Any]"]]

_KINDS = {".npz": "an .npz", ".npy": "a NumPy .npy", ".mat": "a MATLAB", ".h5": "an HDF5", ".hdf5": "an HDF5"}
_HDF5 = b"\x89HDF\r\n\x1a\n"
_MATLAB_HEADER = 512  # bytes before the HDF5 part of a MATLAB 7.3 file
_MATRIX, _COMPRESSED = 14, 15  # types of the elements of a MATLAB file; those of numbers and texts:
_MATLAB_TYPES = (1, 2, 3, 4, 5, 6, 7, 9, 12, 13, 16, 17, 18)
_DATE = r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d"
_FEWEST_GROUPS = 4  # of HDF5 that are a recording each: fewer may be parts of a data set


def headers(path: Path) -> dict[str, tuple[int, ...]]:
    """Return the shape of every array of a file, of which no more than headers are read where it has any.

    Recordings of different lengths are (n, -1, channel), and the columns of a table (-1,).

    Raises:
        RecordingError: the file is empty, cut short, or of another kind.
    """
    return {name: shape for name, (shape, _) in described(path).items()}


def described(path: Path) -> dict[str, tuple[tuple[int, ...], np.dtype[Any]]]:
    """Return the shape and the type of every array; see `headers`. Columns of a table are float64.

    Arrays of a training and of a test set, `X_train` and `X_test`, are the array `X` too, one after the
    other; then `split` says which recordings are of which.
    """
    known = _described(path)
    for name, (train, test) in halves(known).items():
        (shape, kind), (other, _) = known[train], known[test]
        known[name] = ((shape[0] + other[0], *shape[1:]), kind)
        known.setdefault(SPLIT, ((shape[0] + other[0],), np.dtype("U5")))
    return known


def halves(known: Described) -> dict[str, tuple[str, str]]:
    """Return name -> the arrays of a training and of a test set that together are an array of this name."""
    pairs = {}
    for name, (shape, _) in known.items():
        match = re.fullmatch(r"(?:(.+)[_/])?(train(?:ing)?)(?:[_/](.+))?", name, re.IGNORECASE)
        if match is None or bool(match[1]) == bool(match[3]):
            continue
        tests = {x.lower(): x for x in known}
        test = tests.get(name.lower().replace(match[2].lower(), match[2].lower().replace("train", "test")))
        joined = match[1] or match[3]
        if test is not None and joined not in known and shape and known[test][0][1:] == shape[1:]:
            pairs[joined] = (name, test)
    return pairs


def _described(path: Path) -> dict[str, tuple[tuple[int, ...], np.dtype[Any]]]:
    if is_table(path):
        return {str(x): ((-1,), np.dtype(np.float64)) for x in read_table(path, None, head=True).columns}
    kind = _kind(path)
    with _readable(path):
        if kind == "npy":
            array = np.load(path, mmap_mode="r", allow_pickle=False)
            return {ONE: (array.shape, array.dtype)}
        if kind == "npz":
            found = {}
            with zipfile.ZipFile(path) as archive:
                for member in archive.namelist():
                    with archive.open(member) as stream:
                        found[member.removesuffix(".npy")] = _read_header(stream)
            return found
        loaded = _hdf5(path, None, only_shapes=True) if kind == "hdf5" else _READERS[kind](path, None)
    return {name: (_shape_of(array), array.dtype) for name, array in loaded.items()}


def load(path: Path, names: Iterable[str] | None = None) -> dict[str, Array]:
    """Return all arrays of a file, or those of some names; columns of texts in a table are arrays of objects.

    Raises:
        RecordingError: the file is unreadable, a name is not in it, or an array needs pickle.
    """
    chosen = None if names is None else list(dict.fromkeys(names))
    if is_table(path):
        table = read_table(path, None if chosen is None else [x for x in chosen if x in column_names(path)])
        values = {str(name): table[name].to_numpy() for name in table.columns}
    elif (kind := _kind(path)) == "npz":
        known = _described(path)
        values = {name: _npz_member(path, name) for name in chosen or known if name in known}
    else:
        with _readable(path):
            if kind == "npy":
                values = {ONE: np.load(path, allow_pickle=False)}
            else:
                values = _READERS[kind](path, chosen)
    if chosen is not None and (others := [name for name in chosen if name not in values]):
        values |= _joined(path, others)
    return values if chosen is None else {name: values[name] for name in chosen}


def _joined(path: Path, names: Sequence[str]) -> dict[str, Array]:
    """Return arrays that are those of a training and of a test set, one after the other; see `described`."""
    pairs = {} if is_table(path) else halves(_described(path))
    if pairs:
        pairs.setdefault(SPLIT, next(iter(pairs.values())))
    for name in names:
        if name not in pairs:
            raise RecordingError(missing(path, name, headers(path)))
    parts = load(path, [x for name in names for x in pairs[name]])
    joined = {name: [parts[x] for x in pairs[name]] for name in names}
    return {
        name: np.repeat(["train", "test"], [*map(len, of)]) if name == SPLIT else np.concatenate(of)
        for name, of in joined.items()
    }


def missing(path: Path, name: str, known: Iterable[str]) -> str:
    """Return the sentence for an array, or a column of a table, that the file does not hold."""
    what = "column" if is_table(path) else "array"
    return f"{path.name}: no {what} '{name}'; {known_names(name, list(known))}"


def _kind(path: Path) -> str:
    """Return npz, npy, ts, matlab or hdf5, by the ending of a file or, of an .mat file, its first bytes."""
    if path.stat().st_size == 0:
        raise RecordingError(f"{path.name}: the file is empty")
    suffix = path.suffix.lower()
    if suffix not in (".mat", ".h5", ".hdf5"):
        return suffix[1:] if suffix in (".npy", ".ts") else "npz"
    with path.open("rb") as file:
        head = file.read(_MATLAB_HEADER + len(_HDF5))
    is_hdf5 = suffix != ".mat" or _HDF5 in (head[: len(_HDF5)], head[_MATLAB_HEADER:])
    return "hdf5" if is_hdf5 else "matlab"


@contextlib.contextmanager
def _readable(path: Path, part: str = "") -> Iterator[None]:
    """Turn what reading a file, or an array of it, raises into one sentence."""
    try:
        yield
        return
    except RecordingError:
        raise
    except Exception as error:  # readers of damaged files raise anything
        reason = " ".join(str(error).split())
    if "Object arrays" in reason:
        raise RecordingError(
            f"{path.name}: array '{part or ONE}' holds Python objects, such as recordings of different "
            "lengths, which are not read as they may run code; lay the recordings end to end and add their "
            "borders (key offsets), or write them with dse.data.from_arrays"
        )
    of_part = f"array '{part}' of " if part else ""
    kind = _KINDS.get(path.suffix.lower(), "an .npz")
    raise RecordingError(
        f"{path.name}: {of_part}the file cannot be read: it is not {kind} file, or is truncated ({reason})"
    )


def _shape_of(array: Array) -> tuple[int, ...]:
    if array.dtype.kind != "O":
        return array.shape
    widths = {x.shape[1] for x in array if isinstance(x, np.ndarray) and x.ndim == 2}
    return (len(array), -1, widths.pop()) if len(widths) == 1 else (len(array),)


# ---- .npz


def _read_header(stream: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Return shape and type of an array from the header of its .npy; the stream is at its values then."""
    version = npy.read_magic(stream)
    read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, _, dtype = read(stream)
    if min(shape, default=0) < 0:
        raise ValueError(f"an array cannot have shape {shape}")
    return shape, dtype


def _npz_member(path: Path, name: str) -> Array:
    """Return an array that is as large as its header declares, and not far larger than it is stored."""
    with _readable(path, name), np.load(path, allow_pickle=False) as archive:
        member = archive.zip.getinfo(f"{name}.npy")
        with archive.zip.open(member) as stream:
            shape, dtype = _read_header(stream)
            n_bytes = member.file_size - stream.tell()
        if not dtype.hasobject and math.prod(shape) * dtype.itemsize > n_bytes:
            raise RecordingError(
                f"{path.name}: array '{name}' declares {dtype} of shape {shape}, but holds {n_bytes} bytes"
            )
        if n_bytes > max(UNCOMPRESSED_BYTES, MOST_COMPRESSION * member.compress_size):
            raise RecordingError(
                f"{path.name}: array '{name}' must be at most {MOST_COMPRESSION} times as large as it is "
                f"stored, got {n_bytes} bytes in {member.compress_size}"
            )
        values: Array = archive[name]
    return values


# ---- MATLAB and HDF5


def _matlab(path: Path, names: list[str] | None) -> dict[str, Array]:
    from scipy.io import loadmat

    if not (_is_intact(path) or _survives(path, path.stat().st_mtime_ns)):
        raise ValueError("its reader crashes")
    return {
        name: _plain(value)
        for name, value in loadmat(path, variable_names=names).items()
        if isinstance(value, np.ndarray) and not name.startswith("__") and value.dtype.names is None
    }


def _is_intact(path: Path) -> bool:
    """Return whether a MATLAB file holds compressed arrays of numbers and texts alone, with right check sums.

    scipy may crash the process on damaged types, so other files are first read by a process of their own.
    """
    data, at = path.read_bytes(), 128
    order: Literal["big", "little"] = "big" if data[126:128] == b"MI" else "little"
    while at < len(data):
        kind, size = (int.from_bytes(data[at + k : at + k + 4], order) for k in (0, 4))
        stream, at = zlib.decompressobj(), at + 8 + size
        try:
            most = max(UNCOMPRESSED_BYTES, MOST_COMPRESSION * size)
            element = stream.decompress(data[at - size : at], most)
        except zlib.error:
            return False
        if kind != _COMPRESSED or at > len(data) or not stream.eof or not _is_plain(element, order):
            return False
    return True


def _is_plain(element: bytes, order: Literal["big", "little"]) -> bool:
    """Return whether a matrix consists of parts of known types, none of which is a matrix itself."""
    at = 8
    while at + 8 <= len(element):
        kind, size = (int.from_bytes(element[at + k : at + k + 4], order) for k in (0, 4))
        is_small = kind >> 16 > 0  # up to four bytes lie in the tag itself
        if kind & 0xFFFF not in _MATLAB_TYPES:
            return False
        at += 8 if is_small else 8 + -(-size // 8) * 8
    return at == len(element) and int.from_bytes(element[:4], order) == _MATRIX


@functools.cache
def _survives(path: Path, modified_ns: int) -> bool:
    """Return whether a process survives reading a MATLAB file.

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
        return cells_of([x.reshape(-1, 1) if x.ndim == 1 or 1 in x.shape[:1] else x for x in cells])
    return np.char.rstrip(value) if value.dtype.kind in "US" else value


def cells_of(arrays: list[Array]) -> Array:
    """Return arrays as one array of objects."""
    cells = np.empty(len(arrays), object)
    for i, array in enumerate(arrays):
        cells[i] = array
    return cells


def _hdf5(path: Path, names: list[str] | None, only_shapes: bool = False) -> dict[str, Array]:
    """Return arrays of an HDF5 file; with `only_shapes`, empty memory in place of numbers.

    Where all arrays lie in groups that hold the same ones, a group is a recording: see `_together`.
    """
    try:
        import h5py
    except ImportError:
        raise RecordingError(
            f"{path.name}: HDF5 files need h5py, which is not installed; pip install 'dse-spiking[h5]'"
        ) from None
    is_matlab = path.suffix.lower() == ".mat"
    items: dict[str, Any] = {}
    with h5py.File(path, "r") as file:

        def text(codes: Array) -> str:
            return "".join(map(chr, codes.ravel())).rstrip("\0 ")

        def read(item: Any) -> Array:
            kind = item.attrs.get("MATLAB_class", b"")
            if only_shapes and not is_matlab and item.dtype.kind in "biufV":
                return np.broadcast_to(np.empty((), item.dtype), item.shape)
            value = np.asarray(item[()])
            if h5py.check_string_dtype(item.dtype) is not None:
                return np.asarray(item.asstr()[()]).astype(str)
            if kind == b"char":
                return np.array([text(value)])
            if h5py.check_ref_dtype(item.dtype) is not None:
                cells = [file[reference] for reference in value.ravel()]
                if all(cell.attrs.get("MATLAB_class") == b"char" for cell in cells):
                    return np.array([text(np.asarray(cell[()])) for cell in cells])
                matrices = [np.asarray(cell[()]).T for cell in cells]
                return cells_of([x.reshape(-1, 1) if 1 in x.shape[:1] else x for x in matrices])
            return _plain(value.T) if is_matlab else value

        def visit(name: str, item: Any) -> None:
            if isinstance(name, str) and isinstance(item, h5py.Dataset) and not name.startswith("#"):
                items[name] = item

        file.visititems(visit)
        groups: dict[str, dict[str, Any]] = {}
        for name, item in items.items():
            group, _, own = name.rpartition("/")
            groups.setdefault(group, {})[own] = item
        alike = {tuple(sorted(group)) for group in groups.values()}
        is_flat = all(item.ndim <= 2 for item in items.values())
        if len(groups) < _FEWEST_GROUPS or len(alike) > 1 or not is_flat or is_matlab:
            return {name: read(item) for name, item in items.items() if names is None or name in names}
        attributes = [{k: np.asarray(x) for k, x in file[group].attrs.items()} for group in groups]
        shared = set.intersection(*(set(x) for x in attributes)) - {*alike.copy().pop()}
        found = {name: _together([x[name] for x in attributes]) for name in sorted(shared)}
        for own in sorted(alike.pop()):
            if names is None or own in names:
                found[own] = _together([read(group[own]) for group in groups.values()])
    return found


def _ts(path: Path, names: list[str] | None) -> dict[str, Array]:
    """Return `signal` and `label` of a .ts file."""
    signals, labels = ts_file.read(path)
    are_even = len({len(samples) for samples in signals}) == 1
    return {"signal": np.stack(signals) if are_even else cells_of(signals), "label": np.array(labels)}


_READERS: Mapping[str, Callable[[Path, list[str] | None], dict[str, Array]]] = {
    "hdf5": _hdf5,
    "matlab": _matlab,
    "ts": _ts,
}
"""Kind -> reader of a file; more arrays than are named may come."""


def _together(values: list[Array]) -> Array:
    """Return what each recording has under one name: a vector of single values, else a matrix each."""
    if all(x.size == 1 for x in values):
        return np.array([x.ravel()[0] for x in values])
    return cells_of([x.reshape(len(x), -1) if x.ndim else x.reshape(1, 1) for x in values])


# ---- tables


def is_table(path: Path) -> bool:
    """Return whether a file is a table, as a folder of tables is."""
    return path.is_dir() or path.suffix.lower() in (*TABLES, *TEXTS)


def column_names(path: Path) -> list[str]:
    """Return the columns of a table.

    Raises:
        RecordingError: it cannot be read.
    """
    return [str(x) for x in read_table(path, None, head=True).columns]


def read_table(path: Path, columns: list[str] | None, *, head: bool = False) -> pd.DataFrame:
    """Return columns, or all, of a table: .csv, .tsv or .txt, .parquet, or a folder of them.

    The tables of a folder lie one below the other, in the order of their paths below it, which are in column
    `file`; the name of the folder that each lies in is in column `folder`, and the part that folders above
    them name (train, test, validation) in column `split`. A matrix (.npy) is a table whose columns are
    numbered from 0. With `head`, there are no rows.

    Raises:
        RecordingError: it cannot be read, or has no such column.
    """
    import pandas as pd
    import pyarrow

    if path.is_dir():
        return _of_folder(path, columns, head)
    if path.stat().st_size == 0:
        raise RecordingError(f"{path.name}: the file is empty")
    try:
        if path.suffix.lower() in TEXTS:
            marks = head_of(path)
            header: Literal["infer"] | None = "infer" if marks.names is None else None
            return pd.read_csv(
                path, sep=marks.separator, decimal=marks.decimal, header=header, names=marks.names,
                usecols=columns, nrows=0 if head else None, low_memory=False,
            )  # fmt: skip
        if path.suffix.lower() == ".npy":
            matrix = np.load(path, mmap_mode="r", allow_pickle=False)
            if matrix.ndim != 2:
                raise ValueError(f"a recording must be a matrix (step, channel), got shape {matrix.shape}")
            names = [f"{k}" for k in range(matrix.shape[1])]
            return pd.DataFrame(matrix[: 0 if head else None], columns=names)
        if path.suffix.lower() == ".parquet" and head:
            import pyarrow.parquet

            empty: pd.DataFrame = pyarrow.parquet.read_schema(path).empty_table().to_pandas()
            return empty
        if path.suffix.lower() == ".parquet":
            return pd.read_parquet(path, columns=columns)
    except (ValueError, OSError, pyarrow.ArrowException) as error:
        reason = " ".join(str(error).split())
        raise RecordingError(f"{path.name}: the file cannot be read ({reason})") from None
    raise RecordingError(f"{path.name}: a table must be a .csv, .tsv, .txt or .parquet file")


def _of_folder(folder: Path, columns: list[str] | None, head: bool) -> pd.DataFrame:
    import pandas as pd

    names, parts = tables_below(folder), list[pd.DataFrame]()
    of_part = {name: part_of(name) for name in names}
    beside = ["file", "folder", *([] if None in of_part.values() else [SPLIT])]
    own = None if columns is None else [x for x in columns if x not in beside]
    for name in names[: 1 if head else None]:
        try:
            table = read_table(folder / name, own, head=head)
        except RecordingError as error:
            raise RecordingError(f"{folder.name}: {by_path(error, name)}") from None
        if parts and list(table.columns) != list(parts[0].columns[: -len(beside)]):
            text = f"must have the columns of {names[0]}, got {', '.join(table.columns)}"
            raise RecordingError(f"{folder.name}: {name}: {text}")
        of_file = dict(zip(beside, (name, (folder / name).parent.name, of_part[name]), strict=False))
        parts.append(table.assign(**of_file))
    whole = pd.concat(parts, ignore_index=True)
    return whole if columns is None else whole[columns]


def place(path: Path, row: int) -> str:
    """Return where a row of a table is, from 0, as a user finds it: its line in a CSV file."""
    if path.suffix.lower() not in TEXTS:
        return f"row {row}"
    return f"line {row + (2 if not path.is_file() or head_of(path).names is None else 1)}"


def numbers(values: Array, name: str, path: Path) -> Floats:
    """Return a column as float64.

    Raises:
        RecordingError: it holds something else, or a value is missing.
    """
    if values.dtype.kind not in "biuf" or values.ndim != 1:
        raise RecordingError(
            f"{path.name}: column '{name}' must hold numbers, got {first_text(values, path)}"
        )
    if np.isnan(values).any():
        where = place(path, int(np.isnan(values).argmax()))
        raise RecordingError(f"{path.name}: column '{name}' is empty or NaN in {where}")
    return np.asarray(values, dtype=np.float64)


def dates_ms(values: Array) -> Floats | None:
    """Return a column of dates with times, as ISO 8601 has them, in ms since the first; None: others."""
    import pandas as pd

    if values.dtype.kind == "O" and not (len(values) and re.match(_DATE, str(values[0]))):
        return None
    if values.dtype.kind not in "OM":
        return None
    dates = pd.to_datetime(pd.Series(values), format="ISO8601", errors="coerce", utc=True)
    if dates.isna().any():
        return None
    return np.asarray((dates - dates.iloc[0]) / pd.Timedelta(milliseconds=1), np.float64)


def first_text(values: Array, path: Path) -> str:
    """Return the first value of a column that is no number, and where it is."""
    for row, value in enumerate(values.tolist()):
        try:
            float(value)
        except (TypeError, ValueError):
            return f"{str(value)!r} in {place(path, row)}"
    return f"{values.dtype}"


def complete(values: Array, name: str, path: Path) -> Array:
    """Return a column as numbers or texts.

    Raises:
        RecordingError: a value is missing.
    """
    import pandas

    empty = np.asarray(pandas.isna(values))
    if empty.any():
        raise RecordingError(f"{path.name}: '{name}' is empty in {place(path, int(empty.argmax()))}")
    return values if values.dtype.kind in "biuf" else values.astype(str)
