"""Named arrays of a file, read without pickle; every fault is one RecordingError line."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy

from dse.config.bounds import MOST_COMPRESSION, UNCOMPRESSED_BYTES
from dse.config.faults import known_names
from dse.recordings import RecordingError, arrays
from dse.recordings.files import locate
from dse.recordings.labels import shape_faults
from dse.records import Array
from dse.store import DAMAGED_ARCHIVE

Shapes = Mapping[str, tuple[int, ...]]


def headers(path: Path) -> dict[str, tuple[int, ...]]:
    """Return the shape of every array of an .npz file, reading its headers only, or of another (`arrays`).

    Raises:
        RecordingError: the file is empty, cut short, or of another kind.
    """
    if arrays.is_one(path):
        return arrays.headers(path)
    shapes = {}
    try:
        with zipfile.ZipFile(path) as archive:
            for member in archive.namelist():
                with archive.open(member) as stream:
                    shapes[member.removesuffix(".npy")] = read_header(stream)[0]
    except DAMAGED_ARCHIVE as error:
        raise _unreadable(path, error) from None
    return shapes


def read_header(stream: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Return shape and type of an array from the header of its .npy; the stream is at its values then.

    Raises:
        ValueError: it has no such header.
    """
    version = npy.read_magic(stream)
    read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, _, dtype = read(stream)
    if min(shape, default=0) < 0:
        raise ValueError(f"an array cannot have shape {shape}")
    return shape, dtype


def check_size(
    path: Path, member: zipfile.ZipInfo, shape: tuple[int, ...], dtype: np.dtype[Any], n_head: int
) -> None:
    """Check that an array of an .npz is as large as its header declares, and not far larger than the file.

    Args:
        path: the archive.
        member: of the archive.
        shape: declared.
        dtype: declared.
        n_head: bytes of the header.

    Raises:
        RecordingError: it is not.
    """
    name, n_bytes = member.filename.removesuffix(".npy"), member.file_size - n_head
    if not dtype.hasobject and math.prod(shape) * dtype.itemsize > n_bytes:
        raise RecordingError(
            f"{path.name}: array '{name}' declares {dtype} of shape {shape}, but holds {n_bytes} bytes"
        )
    if n_bytes > max(UNCOMPRESSED_BYTES, MOST_COMPRESSION * member.compress_size):
        raise RecordingError(
            f"{path.name}: array '{name}' must be at most {MOST_COMPRESSION} times as large as it is stored, "
            f"got {n_bytes} bytes in {member.compress_size}"
        )


def load(path: Path, names: Iterable[str]) -> dict[str, Array]:
    """Return the named arrays of an .npz file, or of another (`arrays`).

    Raises:
        RecordingError: the file is unreadable, a name is not in it, or an array needs pickle.
    """
    names = list(dict.fromkeys(names))
    values = arrays.load(path, names) if arrays.is_one(path) else {}
    known = values if arrays.is_one(path) else headers(path)
    for name in names:
        if name not in known:
            raise RecordingError(missing(path, name, headers(path)))
        if name in values:
            continue
        try:
            with np.load(path, allow_pickle=False) as archive:
                with archive.zip.open(f"{name}.npy") as stream:
                    shape, dtype = read_header(stream)
                    check_size(path, archive.zip.getinfo(f"{name}.npy"), shape, dtype, stream.tell())
                values[name] = archive[name]
        except DAMAGED_ARCHIVE as error:
            if "Object arrays" in str(error):
                raise RecordingError(arrays.pickled(path.name, name)) from None
            raise _unreadable(path, error, f"array '{name}' of ") from None
    return {name: values[name] for name in names}


def faults(
    file: str,
    base: Path,
    names: Iterable[str],
    columns: Mapping[str, str],
    class_names: Mapping[str, str],
    count: Callable[[Shapes], int | None],
) -> list[str]:
    """Return the faults that an .npz file's headers show: missing file or arrays, labels of wrong length.

    Args:
        file: as the YAML names it.
        base: folder of the YAML.
        names: arrays that are needed.
        columns: column name -> array name.
        class_names: column name -> array of names.
        count: number of recordings from the arrays' shapes, None where they do not tell.
    """
    try:
        path = locate(file, base)
        shapes = headers(path)
    except RecordingError as error:
        return [str(error)]
    absent = [missing(path, name, shapes) for name in dict.fromkeys(names) if name not in shapes]
    n = count(shapes)
    return absent if n is None else absent + shape_faults(shapes, columns, class_names, n, path.name)


def columns_found(
    file: str, base: Path, columns: Mapping[str, str], class_names: Mapping[str, str]
) -> tuple[dict[str, str], dict[str, str]]:
    """Return `columns` and `class_names` without the columns that the file does not hold."""
    shapes = headers(locate(file, base))
    present = {column: source for column, source in columns.items() if source in shapes}
    return present, {c: source for c, source in class_names.items() if c in present}


def missing(path: Path, name: str, known: Mapping[str, object]) -> str:
    """Return the sentence for an array that the file does not hold."""
    return f"{path.name}: no array '{name}'; {known_names(name, known)}"


def _unreadable(path: Path, error: Exception, part: str = "") -> RecordingError:
    if path.stat().st_size == 0:
        return RecordingError(f"{path.name}: the file is empty")
    reason = " ".join(str(error).split())
    return RecordingError(
        f"{path.name}: {part}the file cannot be read: it is not an .npz file, or is truncated ({reason})"
    )
