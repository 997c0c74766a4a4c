"""What is checked of a bundle that is read from disk, before anything else sees it.

Files are opened only if they are regular and lie in the bundle's folder. Arrays are read only if they are as
large as their headers declare. Every fault is a ValueError of one sentence, without the name of the file.
"""

from __future__ import annotations

import math
import stat
import zipfile
from collections.abc import Sequence
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.lib import format as npy

from dse.base.records import Head, Parameters

MOST_BYTES = 2**31
"""Most bytes that the arrays of a bundle may take."""
MOST_DOCUMENT_BYTES = 2**26
_KINDS_OF_NUMBERS = "biuf"


def file_in(folder: Path, name: object) -> Path:
    """Return the path of a file of a bundle: a regular file inside its folder, reached by no link."""
    parts = PurePosixPath(name).parts if isinstance(name, str) else ()
    if not parts or parts[0] == "/" or ".." in parts or "\\" in str(name) or "\0" in str(name):
        raise ValueError("must be a path inside the bundle")
    path = folder
    for part in parts:
        path = path / part
        try:
            mode = path.lstat().st_mode
        except (FileNotFoundError, NotADirectoryError):
            raise ValueError("is missing") from None
        if stat.S_ISLNK(mode):
            raise ValueError(f"must be a file of the bundle, but {path.name} is a symbolic link")
    if not stat.S_ISREG(mode):
        raise ValueError("must be a regular file")
    return path


def check_archive(path: Path) -> None:
    """Check that the arrays of an .npz are as large as their headers declare, and not too large together."""
    total = 0
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
        if len(set(names)) < len(names):
            raise ValueError("an array is stored twice")
        for member in archive.infolist():
            total += member.file_size
            if total > MOST_BYTES:
                raise ValueError(f"its arrays must take at most {MOST_BYTES} bytes, got more")
            with archive.open(member) as stream:
                version = npy.read_magic(stream)
                header = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
                shape, _, dtype = header(stream)
                stored = member.file_size - stream.tell()
            name = member.filename.removesuffix(".npy")
            if dtype.kind not in _KINDS_OF_NUMBERS + "U":
                raise ValueError(f"array '{name}' must hold numbers or texts, got type {dtype}")
            if math.prod(shape) * dtype.itemsize != stored:
                raise ValueError(
                    f"array '{name}' declares shape {shape} of {dtype}, but holds {stored} bytes"
                )


def check_parameters(fitted: Parameters) -> None:
    """Check the arrays of a classifier that is no single network, as far as all families agree."""
    if type(fitted.n_channels) is not int or fitted.n_channels < 1:
        raise ValueError(f"n_channels must be an integer >= 1, got {fitted.n_channels!r}")
    for name, array in fitted.arrays.items():
        if array.dtype.kind == "f" and np.isnan(array).any():
            raise ValueError(f"array '{name}' must hold numbers, got NaN")


def check_heads(heads: Sequence[Head], n_classes: int, head: str) -> None:
    """Check the parts of a joint target, and the name of the one that answers."""
    names = [x.name for x in heads]
    if len(set(names)) < len(names):
        raise ValueError(f"the heads must have different names, got {', '.join(names)}")
    if head and head not in names:
        raise ValueError(f"the head that answers must be one of {', '.join(names) or 'none'}, got {head!r}")
    for each in heads:
        if not each.classes or len(each.of_class) != n_classes:
            raise ValueError(
                f"head '{each.name}' must name a class for each of the {n_classes} joint classes"
            )
        if each.of_class.min() < 0 or each.of_class.max() >= len(each.classes):
            raise ValueError(f"head '{each.name}' must have classes in 0..{len(each.classes) - 1}")
