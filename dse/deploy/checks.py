"""What is checked of a bundle that is read from disk, before anything else sees it.

Files are opened only if they are regular and lie in the bundle's folder. Arrays are read only if they are as
large as their headers declare. Every fault is a ValueError of one sentence, without the name of the file.
"""

from __future__ import annotations

import math
import re
import stat
import zipfile
from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin, get_type_hints

import numpy as np
from numpy.lib import format as npy

from dse.records import Head, Parameters

R = TypeVar("R")

MOST_BYTES = 2**31
"""Most bytes that the arrays of a bundle may take."""
MOST_DOCUMENT_BYTES = 2**26
_NAME = re.compile(r"\w+")
_KINDS_OF_NUMBERS = "biuf"


def file_in(folder: Path, name: object) -> Path:
    """Return the path of a file of a bundle: a regular file inside its folder, reached by no link.

    Raises:
        ValueError: it is something else, or missing.
        OSError: the system cannot look it up.
    """
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
    """Check that the arrays of an .npz are as large as their headers declare, and not too large together.

    Raises:
        ValueError: they are not, or hold something other than numbers and texts.
        OSError, zipfile.BadZipFile: it cannot be read.
    """
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


class Document:
    """A mapping of bundle.json whose values are taken by key and type.

    Every method raises a ValueError that names the key.
    """

    def __init__(self, values: object, place: str = "") -> None:
        if not isinstance(values, dict):
            raise ValueError(f"{place or 'it'} must be a mapping, got {_article(values)}")
        self._values, self._place = values, place

    def _value(self, key: str) -> Any:
        if key not in self._values:
            raise ValueError(f"key '{self._name(key)}' is missing")
        return self._values[key]

    def _name(self, key: str) -> str:
        return f"{self._place}.{key}" if self._place else key

    def mapping(self, key: str) -> dict[str, Any]:
        """Return a mapping."""
        value = self._value(key)
        return Document(value, f"key '{self._name(key)}'")._values

    def part(self, key: str) -> Document:
        """Return a mapping as a document."""
        return Document(self._value(key), self._name(key))

    def text(self, key: str) -> str:
        """Return a text."""
        value = self._value(key)
        if not isinstance(value, str):
            raise ValueError(f"key '{self._name(key)}' must be a text, got {_article(value)}")
        return value

    def is_null(self, key: str) -> bool:
        """Return whether there is no value."""
        return self._value(key) is None

    def texts(self, key: str) -> tuple[str, ...]:
        """Return a list of texts."""
        value = self._value(key)
        if not isinstance(value, list) or not all(isinstance(x, str) for x in value):
            raise ValueError(f"key '{self._name(key)}' must be a list of texts, got {_article(value)}")
        return tuple(value)

    def parts(self, key: str) -> list[Document]:
        """Return a list of mappings."""
        value = self._value(key)
        if not isinstance(value, list):
            raise ValueError(f"key '{self._name(key)}' must be a list, got {_article(value)}")
        return [Document(x, f"{self._name(key)}[{i}]") for i, x in enumerate(value)]

    def integers(self, key: str, low: int, high: int) -> list[int]:
        """Return a list of integers within bounds."""
        value = self._value(key)
        if not isinstance(value, list) or not all(type(x) is int and low <= x <= high for x in value):
            raise ValueError(f"key '{self._name(key)}' must be a list of integers in [{low}, {high}]")
        return list(value)

    def number(self, key: str, low: float = 0.0, high: float = math.inf) -> float:
        """Return a finite number within bounds."""
        value = self._value(key)
        if type(value) not in (int, float) or not (math.isfinite(value) and low <= value <= high):
            within = f"in [{low:g}, {high:g}]" if math.isfinite(high) else f">= {low:g} and finite"
            raise ValueError(f"key '{self._name(key)}' must be a number {within}, got {value!r}")
        return float(value)

    def record(self, key: str, cls: type[R], *optional: str) -> R:
        """Return a mapping as a frozen dataclass: its annotations say what each key must be.

        Args:
            key: of the mapping.
            cls: fields are texts, numbers, numbers of `Annotated[float, low, high]`, words of a `Literal`,
                tuples of texts, mappings of numbers, and any of these or None.
            optional: keys that may be missing.
        """
        part, hints = self.part(key), get_type_hints(cls, include_extras=True)
        return cls(
            **{
                name: part._of_type(name, hint)
                for name, hint in hints.items()
                if name not in optional or name in part._values
            }
        )

    def _of_type(self, key: str, hint: Any) -> Any:
        options = get_args(hint)
        if type(None) in options:
            [hint] = (option for option in options if option is not type(None))
            return None if self._value(key) is None else self._of_type(key, hint)
        if hint is str:
            return self.text(key)
        if get_origin(hint) is tuple:
            return self.texts(key)
        if get_origin(hint) is Literal:
            if (text := self.text(key)) not in options:
                choices = ", ".join(options)
                raise ValueError(f"key '{self._name(key)}' must be one of {choices}, got {text!r}")
            return text
        if get_origin(hint) is Annotated:
            return self.number(key, *options[1:])
        if hint is int:
            return int(self.number(key, high=2**31))
        if hint is float:
            return self.number(key)
        numbers = self.part(key)
        return {name: numbers.number(name, -math.inf) for name in numbers.keys()}

    def keys(self) -> tuple[str, ...]:
        """Return its keys, each a word of letters, digits and underscores."""
        for key in self._values:
            if not isinstance(key, str) or not _NAME.fullmatch(key):
                raise ValueError(f"key '{self._name(str(key))}' must be a word")
        return tuple(self._values)


def _article(value: object) -> str:
    words = {dict: "a mapping", list: "a list", str: f"{value!r:.60}", type(None): "null"}
    return words.get(type(value), f"{value!r:.60}")


def check_parameters(fitted: Parameters) -> None:
    """Check the arrays of a classifier that is no single network, as far as all families agree.

    Raises:
        ValueError: one holds NaN, or the number of channels is none.
    """
    if type(fitted.n_channels) is not int or fitted.n_channels < 1:
        raise ValueError(f"n_channels must be an integer >= 1, got {fitted.n_channels!r}")
    for name, array in fitted.arrays.items():
        if array.dtype.kind == "f" and np.isnan(array).any():
            raise ValueError(f"array '{name}' must hold numbers, got NaN")


def check_heads(heads: Sequence[Head], n_classes: int, head: str) -> None:
    """Check the parts of a joint target, and the name of the one that answers.

    Raises:
        ValueError: what disagrees.
    """
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
