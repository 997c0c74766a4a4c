"""What is checked of a bundle that is read from disk, before anything else sees it.

Files are opened only if they are regular and lie in the bundle's folder. Arrays are read only if they are as
large as their headers declare. Every fault is a ValueError of one sentence, without the name of the file.
"""

from __future__ import annotations

import dataclasses
import math
import re
import stat
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import numpy as np
from numpy.lib import format as npy

from dse.records import Head, Ints, Parameters

MOST_BYTES = 2**31
"""Most bytes that the arrays of a bundle may take."""
MOST_DOCUMENT_BYTES = 2**26
_NAME = re.compile(r"\w+")
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


def typed(value: Any, hint: Any, name: str = "") -> Any:
    """Return a value of a JSON document as an annotation says it must be.

    Args:
        value: as read.
        hint: a dataclass, whose fields with a default may be missing; str, int (not negative), float,
            `Annotated[float, low, high]`, a `Literal`, an array of integers; a tuple or a mapping of any of
            these; any of these or None; Any.
        name: of its key; '' for a document.
    """
    origin, options = get_origin(hint), get_args(hint)
    if type(None) in options:
        [hint] = (option for option in options if option is not type(None))
        return None if value is None else typed(value, hint, name)
    if dataclasses.is_dataclass(hint):
        return _record(value, hint, name)
    if origin is Mapping:
        values = _expected(value, dict, "a mapping", name)
        for key in values if options[1] is not Any else ():
            if not _NAME.fullmatch(key):
                raise ValueError(f"key '{name}.{key}' must be a word")
        return {key: typed(x, options[1], f"{name}.{key}") for key, x in values.items()}
    if origin is tuple:
        is_text = options[0] is str
        values = _expected(value, list, "a list of texts" if is_text else "a list", name)
        if is_text and not all(isinstance(x, str) for x in values):
            raise ValueError(f"key '{name}' must be a list of texts, got {_article(value)}")
        return tuple(typed(x, options[0], f"{name}[{i}]") for i, x in enumerate(values))
    if hint == Ints:
        whole = _expected(value, list, "a list of integers", name)
        return np.array([typed(x, int, f"{name}[{i}]") for i, x in enumerate(whole)], np.int64)
    if origin is Literal:
        if _expected(value, str, "a text", name) not in options:
            raise ValueError(f"key '{name}' must be one of {', '.join(options)}, got {value!r}")
    elif hint is str:
        _expected(value, str, "a text", name)
    elif hint is not Any:
        low, high = (*options[1:], math.inf)[:2] if origin is Annotated else (-math.inf, math.inf)
        return _number(value, hint, name, *((0, 2**31) if hint is int else (low, high)))
    return value


def _record(value: Any, cls: Any, name: str) -> Any:
    """Return a mapping as a dataclass."""
    values, hints = _expected(value, dict, "a mapping", name), get_type_hints(cls, include_extras=True)
    found = {}
    for field in dataclasses.fields(cls):
        key = f"{name}.{field.name}" if name else field.name
        if field.name in values:
            found[field.name] = typed(values[field.name], hints[field.name], key)
        elif field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING:
            raise ValueError(f"key '{key}' is missing")
    return cls(**found)


def _number(value: Any, hint: Any, name: str, low: float, high: float) -> float:
    """Return a finite number within bounds, or an integer."""
    is_number = type(value) is int or (type(value) is float and hint is not int)
    if not is_number or not (math.isfinite(value) and low <= value <= high):
        within = f" in [{low:g}, {high:g}]" if math.isfinite(high) else f" >= {low:g} and finite"
        within = within if math.isfinite(low) else ""
        raise ValueError(f"key '{name}' must be a number{within}, got {value!r:.60}")
    return value if hint is int else float(value)


def _expected(value: Any, cls: type, what: str, name: str) -> Any:
    if not isinstance(value, cls):
        raise ValueError(f"key '{name}' must be {what}, got {_article(value)}")
    return value


def _article(value: object) -> str:
    words = {dict: "a mapping", list: "a list", str: f"{value!r:.60}", type(None): "null"}
    return words.get(type(value), f"{value!r:.60}")


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
